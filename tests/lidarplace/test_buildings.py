"""Buildings stand beside roads: checked by points, which shares no code with their placing."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from lidarplace.logs.boxes import BUILDING_COLUMNS, check_boxes
from lidarplace.scenes.sumo.buildings import REACH_M, build_along, within_reach
from lidarplace.scenes.sumo.maps import build_network

pytest.importorskip("sumolib")
from sumolib.geomhelper import isWithin
from sumolib.net import Net, readNet

MAPS = Path(__file__).parents[1] / "data" / "maps"


@pytest.fixture(scope="module", params=["generated", "street.xodr", "block.net.xml"])
def town(request, tmp_path_factory) -> tuple[Net, pd.DataFrame]:
    name = request.param if request.param == "generated" else str(MAPS / request.param)
    found = build_network(name, 5, tmp_path_factory.mktemp("town"))
    network = readNet(str(found.path), withInternal=True, withPedestrianConnections=True)
    return network, build_along(network, 7, "here")


def lattice(buildings: pd.DataFrame, spacing: float = 0.5) -> list[np.ndarray]:
    """Points over every building, its corners and walls included, each (P, 2)."""
    found = []
    for row in buildings.itertuples():
        sides = (row.length, row.width)
        along = (np.linspace(-side / 2, side / 2, int(side / spacing) + 2) for side in sides)
        u, v = (axis.ravel() for axis in np.meshgrid(*along))
        cos, sin = np.cos(row.yaw), np.sin(row.yaw)
        found.append(np.stack([row.x + cos * u - sin * v, row.y + sin * u + cos * v], axis=1))
    return found


def distance_to_line(points: np.ndarray, shape: np.ndarray) -> np.ndarray:
    best = np.full(len(points), np.inf)
    for start, end in pairwise(shape):
        step = end - start
        t = np.clip((points - start) @ step / max(step @ step, 1e-12), 0, 1)
        best = np.minimum(best, np.hypot(*(points - start - t[:, None] * step).T))
    return best


def test_table(town):
    _, buildings = town
    assert tuple(buildings.columns) == BUILDING_COLUMNS
    check_boxes(buildings.assign(frame=0, **{"class": "Car"}))
    assert set(buildings["scene"]) == {"here"}
    np.testing.assert_array_equal(buildings["z"], buildings["height"] / 2)
    assert buildings["height"].between(3, 21).all()
    assert buildings["length"].between(5, 26).all()
    assert len(buildings) > 10


def test_none_is_on_a_lane_or_a_junction(town):
    network, buildings = town
    points = np.concatenate(lattice(buildings, 1.5))
    for edge in network.getEdges():
        for lane in edge.getLanes() if edge.getFunction() != "walkingarea" else ():
            shape = np.array(lane.getShape())[:, :2]
            assert distance_to_line(points, shape).min() > lane.getWidth() / 2 - 1e-6
    points = np.concatenate(lattice(buildings, 8.0))
    walked = [edge for edge in network.getEdges() if edge.getFunction() == "walkingarea"]
    areas = [lane.getShape() for edge in walked for lane in edge.getLanes()]
    for polygon in [*areas, *(node.getShape() for node in network.getNodes())]:
        shape = np.array(polygon).reshape(len(polygon), -1)[:, :2]
        if len(shape) < 3:
            continue
        near = points[((points > shape.min(axis=0)) & (points < shape.max(axis=0))).all(axis=1)]
        assert not any(isWithin(tuple(point), shape.tolist()) for point in near)


def test_none_overlap(town):
    _, buildings = town
    every = lattice(buildings)
    for index, row in enumerate(buildings.itertuples()):
        others = np.concatenate(every[:index] + every[index + 1 :]) - [row.x, row.y]
        cos, sin = np.cos(row.yaw), np.sin(row.yaw)
        u = np.abs(others @ [cos, sin])
        v = np.abs(others @ [-sin, cos])
        assert not ((u < row.length / 2 - 1e-6) & (v < row.width / 2 - 1e-6)).any()


def test_they_face_a_road(town):
    """The wall towards the nearest road is parallel to some piece of it."""
    network, buildings = town
    directions = []
    for edge in network.getEdges(withInternal=False):
        step = np.diff(np.array(edge.getLanes()[0].getShape())[:, :2], axis=0)
        directions.append(np.arctan2(step[:, 1], step[:, 0]))
    directions = np.concatenate(directions)
    turn = np.abs(np.sin(buildings["yaw"].to_numpy()[:, None] - directions)).min(axis=1)
    assert (turn < 0.2).all()


def test_most_of_the_frontage_is_built(town):
    """Every metre of sidewalk or curb looks 16 m to its right: what share sees a house?"""
    network, buildings = town
    points = np.concatenate(lattice(buildings))
    seen = []
    for edge in network.getEdges(withInternal=False):
        shape = np.array(edge.getLanes()[0].getShape())[:, :2]
        for start, end in pairwise(shape):
            length = np.hypot(*(end - start))
            along = (end - start) / length
            offset = points - start
            u = offset @ along
            v = offset @ [along[1], -along[0]]
            front = u[(v > 0) & (v < 16)]
            seen += [bool((np.abs(front - s) < 0.5).any()) for s in np.arange(0.5, length)]
    assert 0.5 < np.mean(seen) < 0.85


def test_the_seed_decides(town):
    network, buildings = town
    assert build_along(network, 7, "here").equals(buildings)
    assert not np.isin(build_along(network, 8, "here")["x"], buildings["x"]).any()


def test_far_ones_are_left_out(town):
    _, buildings = town
    positions = np.array([[0.0, 0.0], [10.0, 0.0]])
    near = within_reach(buildings, positions)
    apart = (p[:, None] - positions for p in lattice(buildings))
    nearest = np.array([np.hypot(*offset.transpose(2, 0, 1)).min() for offset in apart])
    must = buildings[nearest <= REACH_M]
    assert set(must["x"]) <= set(near["x"])
    far = np.hypot(buildings["x"] - 10, buildings["y"]) > REACH_M + 40
    assert not np.isin(buildings["x"][far], near["x"]).any()
