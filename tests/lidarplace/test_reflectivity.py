"""Reflectivities: the table, the ground, walls and signs, and that they do not tell the class."""

import math

import numpy as np
import pandas as pd
import pytest

from lidarplace.clouds.collect import collect
from lidarplace.clouds.ground import CELL_M, CELLS, square
from lidarplace.clouds.raycast import GROUND
from lidarplace.clouds.reflectivity import REFLECTIVITY, Material, reflectivity
from lidarplace.clouds.returns import ATTENUATION_PER_M, CloudPart, sample_points
from lidarplace.clouds.shapes import BUILDING, SIGN, bricks
from lidarplace.clouds.surroundings import Surroundings, facades
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement
from tests.lidarplace.from_a_car import cast

CROP = (0.0, -20.0, -0.5, 40.0, 20.0, 4.0)
RETROREFLECT = {Material.RETROREFLECTOR, Material.LAMP, Material.MARKING}


@pytest.mark.parametrize("material", REFLECTIVITY)  # light passes glass
def test_quantiles_rise_from_share_0_to_1(material):
    share, value = np.array(REFLECTIVITY[material]).T
    assert (share[0], share[-1]) == (0, 1)
    assert (np.diff(share) > 0).all()
    assert (np.diff(value) > 0).all()
    assert value[0] > 0
    assert (value[-1] > 1) == (material in RETROREFLECT)


def test_draws_follow_the_quantiles():
    shares = np.random.default_rng(0).random(20_000)
    for material, knots in REFLECTIVITY.items():
        drawn = reflectivity(np.full(len(shares), material), shares)
        for share, value in knots:
            assert (drawn <= value).mean() == pytest.approx(share, abs=0.015)


def test_a_number_that_is_no_material():
    with pytest.raises(ValueError, match="no material 99"):
        reflectivity(np.array([0, 99]), np.array([0.5, 0.5]))


def street(frames: int = 40) -> tuple[BoxLog, np.ndarray]:
    """Cars one behind the other on two lanes between two rows of houses, new ones in each frame."""
    rng = np.random.default_rng(3)
    places = [(x, y) for x in (8.0, 16.0, 24.0, 32.0) for y in (-4.0, 4.0)]
    boxes = pd.DataFrame(
        [(x + rng.uniform(-1, 1), y, 0.75, 4.5, 1.8, 1.5, 0.0) for x, y in places * frames],
        columns=list(GEOMETRY),
    )
    frame = np.repeat(np.arange(frames), len(places))
    boxes = boxes.assign(
        scene="a", frame=frame, object_id=np.arange(len(boxes)), **{"class": "Car"}
    )
    listed = pd.DataFrame({"scene": "a", "frame": np.arange(frames)})
    # Another part of a long street in each frame.
    listed = listed.assign(ego_x=300.0 * np.arange(frames), ego_y=0.0, ego_yaw=0.0)
    places = [(x, y) for x in (5.0, 22.0, 39.0) for y in (-12.0, 12.0)]
    rows = [(x, y, 4.0, 14.0, 8.0, 8.0, 0.0) for x, y in places]
    houses = [("a", 300.0 * f + x, *rest) for f in range(frames) for x, *rest in rows]
    walls = pd.DataFrame(houses, columns=["scene", *GEOMETRY])
    return BoxLog(boxes, listed, walls), np.arange(frames)


def test_a_threshold_on_the_intensity_does_not_find_the_cars():
    """With one reflectivity a material, 97 % of these cars outshone all else of their frame; the
    best threshold was right in 0.64 and 0.73."""
    log, frames = street()
    lidar = Lidar(tuple(np.radians(np.linspace(-25, 5, 16))), azimuth_steps=1800)
    clouds = collect(log, frames, Placement("a", [Mount(z=2.2)], lidar), CROP)
    outshine, on_cars, on_walls, elsewhere = [], [], [], []
    for frame, points in zip(frames, clouds, strict=True):
        light, rest = points[:, 3], np.ones(len(points), bool)
        brightest = []
        for x, y in log.boxes.loc[log.boxes["frame"] == frame, ["x", "y"]].to_numpy():
            own = (np.abs(points[:, 0] - x) < 2.26) & (np.abs(points[:, 1] - y) < 0.91)
            own &= points[:, 2] > 0.01
            rest &= ~own
            if own.sum() >= 5:
                brightest.append(light[own].max())
                on_cars.append(light[own])
        outshine += [value > light[rest].max() for value in brightest]
        on_walls.append(light[rest & (points[:, 2] > 0.01)])
        elsewhere.append(light[rest])
    assert len(outshine) > 150
    assert np.mean(outshine) < 0.1
    cars = np.concatenate(on_cars)
    for others, limit in ((np.concatenate(elsewhere), 0.6), (np.concatenate(on_walls), 0.69)):
        thresholds = np.arange(256) / 255 + 1e-3
        hit = np.array([(cars > t).mean() for t in thresholds])
        alarm = np.array([(others > t).mean() for t in thresholds])
        assert 0.5 + 0.5 * np.abs(hit - alarm).max() < limit
    # All are drawn from a whole range, and none is beyond it.
    assert cars.min() < 0.05
    assert cars.max() == 1


def test_the_ground_stays_where_it_is():
    """What lies at a place of the world has one reflectivity, from wherever it is seen."""
    poses = [(100.0, 50.0, 0.4), (104.0, 53.0, -2.5)]
    frames = pd.DataFrame(
        [("a", n, *pose) for n, pose in enumerate(poses)],
        columns=["scene", "frame", "ego_x", "ego_y", "ego_yaw"],
    )
    none = pd.DataFrame(columns=["frame", "class", "object_id", *GEOMETRY])
    none = none.astype(dict.fromkeys(GEOMETRY, float) | {"frame": int})
    surroundings = Surroundings(BoxLog(none, frames))
    lidar = Lidar(tuple(np.radians(np.linspace(-25, -4, 40))), azimuth_steps=1800)
    mount, everywhere = Mount(z=2.2), (-99.0, -99.0, -9.0, 99.0, 99.0, 9.0)
    hits = cast(mount, lidar, bricks(np.empty((0, 7)), 0))
    seen = []
    for frame, (x, y, yaw) in enumerate(poses):
        points = np.empty((lidar.rays, 4), np.float32)
        ground = surroundings.ground(frame)
        number = sample_points(mount, lidar, hits, ground, everywhere, CloudPart((0, 0, 0)), points)
        points = points[:number].astype(float)
        assert number == (hits.target == GROUND).sum()
        distance = np.hypot(np.hypot(points[:, 0], points[:, 1]), mount.z)
        bright = points[:, 3] * distance / mount.z * np.exp(ATTENUATION_PER_M * distance)
        c, s = math.cos(yaw), math.sin(yaw)
        world = x + c * points[:, 0] - s * points[:, 1], y + s * points[:, 0] + c * points[:, 1]
        place = pd.DataFrame({"u": world[0] / CELL_M, "v": world[1] / CELL_M, "bright": bright})
        inside = (place[["u", "v"]] % 1 - 0.5).abs().max(axis=1) < 0.49  # not on an edge
        place = place[inside & (points[:, 3] < 1)].astype({"u": int, "v": int})
        assert (place.groupby(["u", "v"])["bright"].agg(np.ptp) < 1e-4).all()
        seen.append(place.groupby(["u", "v"])["bright"].mean())
    both = pd.concat(seen, axis=1, join="inner")
    assert len(both) > 1000
    np.testing.assert_allclose(both.iloc[:, 0], both.iloc[:, 1], rtol=1e-4)
    assert both.iloc[:, 0].nunique() > 5


def test_frames_without_a_pose_lie_somewhere():
    frames = pd.DataFrame({"scene": "a", "frame": [3, 4]})
    log, again = street(1)[0], street(1)[0]
    log, again = (BoxLog(one.boxes[:0], frames) for one in (log, again))
    poses = [Surroundings(log).ground(n).pose for n in (3, 4)]
    assert poses[0] != poses[1]
    assert poses == [Surroundings(again).ground(n).pose for n in (3, 4)]
    for nowhere in (math.nan, math.inf, "here", pd.NA, None):
        unknown = frames.assign(ego_x=nowhere, ego_y=0.0, ego_yaw=0.0)
        assert Surroundings(BoxLog(log.boxes, unknown)).ground(3).pose == poses[0]


def test_the_ground_is_of_several_materials_and_has_marks():
    cells = square(0)
    assert cells.shape == (CELLS, CELLS)
    assert cells.dtype == np.float32
    assert 0.004 < (cells > 0.62).mean() < 0.05  # marks: no other material is so bright
    assert np.percentile(cells, 5) < 0.15
    assert np.percentile(cells, 95) > 0.35
    assert not np.array_equal(cells, square(1))


def test_a_building_looks_the_same_in_every_table():
    rng = np.random.default_rng(1)
    buildings = rng.uniform(2, 20, (50, 7))
    looks = facades(buildings, 0)
    order = rng.permutation(50)
    other = facades(buildings[order], 0)
    for owner in (BUILDING, SIGN):
        here, there = looks.owner == owner, other.owner == owner
        np.testing.assert_array_equal(looks.geometry[here][order], other.geometry[there])
        np.testing.assert_array_equal(looks.reflectivity[here][order], other.reflectivity[there])
    np.testing.assert_array_equal(looks.geometry[looks.owner == BUILDING][:, :7], buildings)
    assert len(np.unique(looks.reflectivity)) == 100
    assert not np.array_equal(facades(buildings, 1).reflectivity, looks.reflectivity)


@pytest.mark.parametrize("size", [(14.0, 8.0, 9.0), (0.4, 3.0, 0.5), (0.0, 0.0, 0.0)])
def test_a_sign_is_on_its_walls(size):
    """Front and back it stands out by 5 cm, and nowhere else."""
    for y in np.linspace(-20, 20, 30):
        building = np.array([[5.0, y, 10.0, *size, 0.0]])
        looks = facades(building, 0)
        sign = looks.geometry[looks.owner == SIGN][0]
        low, high = sign[:3] - sign[3:6] / 2, sign[:3] + sign[3:6] / 2
        wall_low, wall_high = (building[0, :3] + side * np.array(size) / 2 for side in (-1, 1))
        np.testing.assert_allclose([wall_low[1] - low[1], high[1] - wall_high[1]], 0.05)
        assert (low[[0, 2]] >= wall_low[[0, 2]] - 1e-9).all()
        assert (high[[0, 2]] <= wall_high[[0, 2]] + 1e-9).all()
