"""Buildings along the roads of a town: rectangles that stand on no lane and in no other."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lidarplace.logs.boxes import BUILDING_COLUMNS
from lidarplace.scenes.sumo.trajectories import LEVEL_M, Trajectories

if TYPE_CHECKING:
    from sumolib.net import Net
    from sumolib.net.edge import Edge


Rectangles = NDArray[np.float64]
"""Rectangles on the ground: x, y, yaw, half of the length, half of the width; (P, 5)."""


def overlaps(traffic: Trajectories) -> NDArray[np.int64]:
    """Find all pairs of road users on one level whose rectangles on the ground meet.

    Shape (P, 3), int64: recorded step, and the two indices, ascending."""
    half = np.array([(user.length, user.width) for user in traffic.users]) / 2
    radius = np.hypot(*half.T)
    reach = radius[:, None] + radius
    pairs = []
    for step, pose in enumerate(traffic.pose):
        distance = np.hypot(*(pose[:, None, :2] - pose[None, :, :2]).transpose(2, 0, 1))
        level = np.abs(traffic.z[step][:, None] - traffic.z[step]) <= LEVEL_M
        a, b = np.nonzero(np.triu((distance <= reach) & level, 1))  # False where NaN
        users = np.hstack([pose, half])
        meet = rectangles_meet(users[a], users[b])
        pairs.append(np.stack([np.full(meet.sum(), step), a[meet], b[meet]], axis=1))
    return np.concatenate(pairs)


def rectangles_meet(a: Rectangles, b: Rectangles) -> NDArray[np.bool_]:
    """Return whether the n-th of `a` and the n-th of `b` share a point, shape (P,).

    Two convex shapes are apart exactly if some edge's normal separates them; rectangles have two
    normals each."""
    dx, dy, turn = (b - a)[:, :3].T
    cos, sin = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    meet = np.ones(len(a), bool)
    for (_, _, yaw, length, width), (*_, far, wide) in ((a.T, b.T), (b.T, a.T)):
        c, s = np.cos(yaw), np.sin(yaw)
        meet &= np.abs(c * dx + s * dy) <= length + cos * far + sin * wide
        meet &= np.abs(c * dy - s * dx) <= width + sin * far + cos * wide
    return meet


ROUNDS = (((12.0, 26.0), (8.0, 14.0), (0.3, 16.0)), ((7.0, 12.0), (6.0, 9.0), (10.0, 50.0)))
"""Length along the road and depth of a building, and the gap to the next one, metres: large ones
first, then smaller ones where room is left. Together they line two thirds of a street."""
SETBACK_M = (0.5, 4.0)  # from the outer edge of the road, its sidewalk included, to the wall
VERGE_M = (4.0, 12.0)  # the same for every lane, where there is no sidewalk or the road is broad
BROAD = 3
"""Lanes one way from which on a road counts as a highway: houses keep away, and there are none
between its halves."""
STOREYS = (1, 6)
STOREY_M = 3.2
REACH_M = 80.0  # buildings farther from every recorded pose are left out


def build_along(network: Net, seed: int, name: str, lefthand: bool = False) -> pd.DataFrame:
    """Place the buildings of town `name`, columns `BUILDING_COLUMNS`, in the frame of the network.

    The log is flat, so all stand on z = 0, and none over or under a bridge. `network` was read with
    its junctions' inner lanes; `lefthand` says that vehicles keep left."""
    rng = np.random.default_rng(seed)
    roads, polygons = _roads(network)
    edges = sorted(network.getEdges(withInternal=False), key=lambda edge: edge.getID())
    ends = {(edge.getFromNode().getID(), edge.getToNode().getID()) for edge in edges}
    built = np.empty((0, 5))
    for sizes in ROUNDS:
        fronts = [
            front
            for edge in edges
            for side in _sides(edge, ends)
            for front in _frontage(edge, side, lefthand, *sizes, rng)
        ]
        new = np.array(fronts).reshape(-1, 5)
        new = new[~meets_any(new, roads) & ~meets_any(new, built) & ~_inside_any(new, polygons)]
        built = np.concatenate([built, new[_first_come(new)]])
    storeys = rng.integers(STOREYS[0], STOREYS[1] + 1, len(built))
    height = STOREY_M * storeys + rng.uniform(0, 1, len(built))
    x, y, yaw, length, depth = built.T
    columns = (name, x, y, height / 2, 2 * length, 2 * depth, height, yaw)
    table = pd.DataFrame(dict(zip(BUILDING_COLUMNS, columns, strict=True)))
    return table.astype({"scene": str})


def within_reach(buildings: pd.DataFrame, positions: NDArray[np.float64]) -> pd.DataFrame:
    """Select buildings of which some part may be within `REACH_M` of one of `positions`, (F, 2)."""
    distance, _ = cKDTree(positions).query(buildings[["x", "y"]].to_numpy(np.float64))
    radius = np.hypot(buildings["length"], buildings["width"]) / 2
    near = np.asarray(distance) - radius <= REACH_M
    return buildings[near].reset_index(drop=True)


def _sides(edge: Edge, ends: set[tuple[str, str]]) -> tuple[int, ...]:
    """Return sides of an edge with buildings: -1 the kerb's, 1 the other without a way back."""
    back = (edge.getToNode().getID(), edge.getFromNode().getID())
    return (-1,) if back in ends or _drive_lanes(edge) >= BROAD else (-1, 1)


def _drive_lanes(edge: Edge) -> int:
    return sum(lane.allows("passenger") for lane in edge.getLanes())


def _frontage(
    edge: Edge,
    side: int,
    lefthand: bool,
    lengths: tuple[float, float],
    depths: tuple[float, float],
    gaps: tuple[float, float],
    rng: np.random.Generator,
) -> list[tuple[float, float, float, float, float]]:
    """Line one side of an edge with buildings: x, y, yaw, half length, half depth."""
    lanes = edge.getLanes()
    lane = lanes[0] if side < 0 else lanes[-1]
    left = -side if lefthand else side
    shape = np.array(lane.getShape(), np.float64)[:, :2]
    steps = np.diff(shape, axis=0)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))])
    sidewalk = any(each.allows("pedestrian") and not each.allows("passenger") for each in lanes)
    lane_count = min(max(_drive_lanes(edge), 1), BROAD)
    street = sidewalk and lane_count < BROAD
    setbacks = SETBACK_M if street else np.multiply(VERGE_M, lane_count)
    buildings = []
    place = rng.uniform(-lengths[0], gaps[1])
    while place < along[-1]:
        length, depth = rng.uniform(*lengths), rng.uniform(*depths)
        setback = rng.uniform(*setbacks)
        ends = np.clip([place, place + length], 0, along[-1])
        if ends[1] > ends[0]:
            (x0, x1), (y0, y1) = (np.interp(ends, along, shape[:, k]) for k in range(2))
            yaw = np.arctan2(y1 - y0, x1 - x0)
            out = left * (lane.getWidth() / 2 + setback + depth / 2)
            x, y = (x0 + x1) / 2 - out * np.sin(yaw), (y0 + y1) / 2 + out * np.cos(yaw)
            buildings.append((x, y, yaw, length / 2, depth / 2))
        place += length + rng.uniform(*gaps)
    return buildings


def _roads(network: Net) -> tuple[Rectangles, list[NDArray[np.float64]]]:
    """Return the ground that is kept free, as rectangles and polygons.

    Every piece of every lane and crossing, with its width; and the outlines of junctions and
    walking areas, once as polygons and once as rectangles without width."""
    areas = (edge for edge in network.getEdges() if edge.getFunction() == "walkingarea")
    shapes = [
        *(node.getShape() for node in network.getNodes() if len(node.getShape()) > 2),
        *(lane.getShape() for edge in areas for lane in edge.getLanes()),
    ]
    polygons = [np.array(shape, np.float64)[:, :2] for shape in shapes]
    outlines = [
        np.column_stack([polygon, np.roll(polygon, -1, axis=0), np.zeros(len(polygon))])
        for polygon in polygons
    ]
    return np.concatenate([lane_rectangles(network), _rectangles(outlines)]), polygons


def lane_rectangles(network: Net, vehicles: Collection[str] = ()) -> Rectangles:
    """Return every piece of every lane and crossing, or of the lanes for SUMO's classes alone."""
    pieces = []
    for edge in network.getEdges():
        for lane in edge.getLanes() if edge.getFunction() != "walkingarea" else ():
            if not vehicles or any(map(lane.allows, vehicles)):
                shape = np.array(lane.getShape(), np.float64)[:, :2]
                width = np.full(len(shape) - 1, lane.getWidth() / 2)
                pieces.append(np.column_stack([shape[:-1], shape[1:], width]))
    return _rectangles(pieces)


def _rectangles(pieces: Sequence[NDArray[np.float64]]) -> Rectangles:
    """Return rectangles around segments: rows of start, end and half of the width."""
    start, end, width = np.split(np.concatenate([np.empty((0, 5)), *pieces]), [2, 4], axis=1)
    step = end - start
    # Half a lane's width longer at both ends, so that bends are covered.
    half_length = np.hypot(step[:, 0], step[:, 1]) / 2 + width[:, 0]
    yaw = np.arctan2(step[:, 1], step[:, 0])
    return np.column_stack([(start + end) / 2, yaw, half_length, width])


def _pairs(rectangles: Rectangles, others: Rectangles) -> NDArray[np.int64]:
    """Return indices (P, 2) of rectangles of both that meet."""
    pairs = [np.empty((0, 2), np.int64)]
    if len(rectangles) and len(others):
        radius, radii = (np.hypot(*each[:, 3:].T) for each in (rectangles, others))
        # Long ones are searched on their own, lest their reach makes all others neighbours.
        group = np.digitize(radii, np.quantile(radii, [0.5, 0.9]))
        for members in (np.flatnonzero(group == g) for g in range(3) if (group == g).any()):
            tree, reach = cKDTree(others[members, :2]), radius + radii[members].max()
            near = tree.query_ball_point(rectangles[:, :2], reach)
            a = np.repeat(np.arange(len(rectangles)), [len(n) for n in near])
            b = members[np.concatenate([np.array(n, np.int64) for n in near])]
            pairs.append(np.column_stack([a, b])[rectangles_meet(rectangles[a], others[b])])
    return np.concatenate(pairs)


def meets_any(rectangles: Rectangles, others: Rectangles) -> NDArray[np.bool_]:
    """Return which rectangles share a point with one of `others`, shape (n,)."""
    return np.isin(np.arange(len(rectangles)), _pairs(rectangles, others)[:, 0])


def _first_come(rectangles: Rectangles) -> NDArray[np.bool_]:
    """Return a mask of the rectangles that stay if each gives way to those that stay before it."""
    stays = np.ones(len(rectangles), bool)
    pairs = _pairs(rectangles, rectangles)
    for a, b in pairs[np.lexsort(pairs.T)]:  # by the later one
        if a < b and stays[a]:
            stays[b] = False
    return stays


def _inside_any(rectangles: Rectangles, polygons: list[NDArray[np.float64]]) -> NDArray[np.bool_]:
    """Return a mask of centres inside a polygon: an odd number of its edges is to their right."""
    inside = np.zeros(len(rectangles), bool)
    x, y = rectangles[:, :1], rectangles[:, 1:2]
    for polygon in polygons:
        (x0, y0), (x1, y1) = polygon.T, np.roll(polygon, -1, axis=0).T
        straddles = (y0 > y) != (y1 > y)
        with np.errstate(divide="ignore", invalid="ignore"):
            right = x < x0 + (y - y0) / (y1 - y0) * (x1 - x0)
        inside |= (straddles & right).sum(axis=1) % 2 == 1
    return inside
