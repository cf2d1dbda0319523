"""Point clouds of placements: independence of portions, noise, drop-off, crop, buildings."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from lidarplace.clouds.collect import SimulatedClouds, collect, crop_for
from lidarplace.clouds.ground import CELL_M, CELLS, Ground
from lidarplace.clouds.raycast import GROUND
from lidarplace.clouds.returns import ATTENUATION_PER_M, LARGEST_ERROR, CloudPart, sample_points
from lidarplace.clouds.shapes import PANE, SIGN, bricks
from lidarplace.clouds.surroundings import Surroundings
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.mounting.errors import MountingErrors
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement
from lidarplace.rigs.pose import rotation
from tests.lidarplace.from_a_car import cast
from tests.refused import refused

CROP = (0.0, -20.0, -1.0, 40.0, 20.0, 4.0)
LIDAR = Lidar(tuple(np.radians(np.linspace(-25, 5, 8))), azimuth_steps=900)
NOISY = replace(LIDAR, range_noise=0.05, drop_off=0.2)
TWO = [Mount(y=0.5, z=2.2, roll=0.28), Mount(x=0.5, z=2.4, yaw=1.0)]
GRID_M = 0.0005  # clouds are kept to half a millimetre


def log(frames: int = 6, per_frame: int = 8, x=(6, 35), y=(-18, 18)) -> BoxLog:
    rng = np.random.default_rng(5)
    rows = frames * per_frame
    table = pd.DataFrame(rng.uniform(1.5, 4, (rows, 7)), columns=list(GEOMETRY))
    table["x"], table["y"] = rng.uniform(*x, rows), rng.uniform(*y, rows)
    table["z"] = table["height"] / 2
    table.insert(0, "frame", np.repeat(np.arange(frames), per_frame))
    table.insert(1, "class", rng.choice(["Car", "Cyclist", "Pedestrian"], rows))
    table.insert(2, "object_id", np.arange(rows))
    table = table.sample(frac=1, random_state=1, ignore_index=True)
    listed = pd.DataFrame({"scene": "a", "frame": np.arange(frames)})
    return BoxLog(table, listed)


def empty(frames: int = 1) -> BoxLog:
    return BoxLog(log().boxes[:0], log(frames).frames)


def all_points(clouds) -> np.ndarray:
    return np.concatenate([np.empty((0, 4), np.float32), *clouds])


def test_portions_and_order_of_frames_change_nothing():
    placement = Placement("two", TWO, lidar=NOISY)
    whole = collect(log(), [0, 1, 2, 3, 4, 5], placement, CROP, seed=7)
    assert len(whole) == 6
    for frames in ([4, 1], [5], [2, 0, 3]):
        part = collect(log(), frames, placement, CROP, seed=7)
        for i, frame in enumerate(frames):
            np.testing.assert_array_equal(part[i], whole[frame])


@pytest.mark.parametrize("misaligned", [False, True])
def test_simulated_clouds_are_the_kept_ones_to_the_last_bit(misaligned):
    placement = Placement("two", TWO, lidar=NOISY)
    crop = crop_for((0.0, 80.0), (-20.3, 20.0), (0.0, 4.0), placement, misaligned)  # a coarse grid
    arguments = (log(), [4, 1, 3], placement, crop, 7, misaligned)
    kept, simulated = collect(*arguments), SimulatedClouds(*arguments)
    assert simulated.frames.tolist() == kept.frames.tolist()
    first = simulated[0]
    assert len(first) > 100
    for index in (2, 0, 1):
        np.testing.assert_array_equal(simulated[index], kept[index])
    np.testing.assert_array_equal(first, kept[0])  # not written over by later frames


def brightness(ground: Ground, points: np.ndarray) -> np.ndarray:
    """Reflectivity of the ground at points of the ego frame."""
    x, y, yaw = ground.pose
    world = points[:, :2] @ rotation(0, 0, yaw)[:2, :2].T + [x, y]
    column, row = np.floor(world / CELL_M).astype(int).T % CELLS
    return ground.reflectivity[row, column]


def test_points_are_the_hits_within_the_crop():
    mount = TWO[0]
    surroundings = Surroundings(log())
    hits = cast(mount, LIDAR, surroundings.parts(2, reach=100.0))
    kept = hits.target >= SIGN
    points = mount.position + hits.range[kept, None] * (LIDAR.directions() @ mount.rotation.T)[kept]
    inside = ((points >= CROP[:3]) & (points <= CROP[3:])).all(axis=1)
    light = hits.reflected[kept] * np.exp(-ATTENUATION_PER_M * hits.range[kept])
    on_ground = hits.target[kept] == GROUND
    light[on_ground] *= brightness(surroundings.ground(2), points[on_ground])
    intensity = np.minimum(light, 1)
    assert on_ground.any()
    assert (light > 1).any()  # a retroreflector, which saturates
    cloud = collect(log(), [2], Placement("one", [mount], lidar=LIDAR), CROP)[0]
    np.testing.assert_allclose(cloud[:, :3], points[inside], atol=GRID_M + 1e-5)
    np.testing.assert_allclose(cloud[:, 3], intensity[inside], atol=0.5 / 255 + 1e-6)


@pytest.mark.parametrize(
    "limits",
    [
        {"min_range": 12.0},
        {"range_10": 9.0},
        {"range_10": 12.0, "range_80": 20.0, "min_range": 7.0, "range_noise": 0.05},
        {"range_10": 15.0, "range_80": 25.0, "extinction": 0.01, "window": 0.9},
    ],
)
def test_what_is_too_near_or_too_dark_returns_nothing(limits):
    mount, wide = TWO[0], (-100.0, -100.0, -5.0, 100.0, 100.0, 50.0)
    lidar = replace(LIDAR, range_noise=limits.get("range_noise", 0.0))
    surroundings = Surroundings(log())
    hits = cast(mount, lidar, surroundings.parts(2, reach=100.0))
    kept = np.flatnonzero(hits.target >= SIGN)
    ground = surroundings.ground(2)
    points = np.empty((lidar.rays, 4), np.float32)

    def returned(sensor):
        count = sample_points(mount, sensor, hits, ground, wide, CloudPart((0, 2, 0)), points)
        return points[:count].copy()

    everything = returned(lidar)
    assert len(everything) == len(kept)
    light, on_ground = hits.reflected[kept].copy(), hits.target[kept] == GROUND
    light[on_ground] *= brightness(ground, everything[on_ground].astype(float))
    limited = replace(lidar, **limits)
    far = limited.sight(light)
    distance = hits.range[kept]
    clear = (abs(distance - far) > 1e-3) & (abs(distance - limited.min_range) > 1e-3)
    seen = (distance >= limited.min_range) & (distance <= far)
    assert 20 < seen.sum() < len(kept) - 20
    found = {tuple(point[:3]): point[3] for point in returned(limited)}
    # A point whose patch of ground is rounded to the neighbour may be of either.
    right = [
        (tuple(p[:3]) in found) == s for p, s in zip(everything[clear], seen[clear], strict=True)
    ]
    assert np.mean(right) > 0.999
    assert len(found) <= len(everything)
    left = limited.window**2 * np.exp(-2 * limited.extinction * distance)
    for point, share in zip(everything, left, strict=True):
        if tuple(point[:3]) in found and point[3] < 1 and not lidar.range_noise:
            assert found[tuple(point[:3])] == pytest.approx(share * point[3], rel=1e-5)


def test_points_of_a_field_of_view_are_those_of_the_whole_turn_within_it():
    ahead = replace(LIDAR, azimuth=(-0.5, 0.7))
    mount, behind = Mount(z=2.2), Mount(z=2.2, yaw=math.pi)
    full = collect(log(), [0, 3], Placement("a", [mount], lidar=LIDAR), CROP)
    points = all_points(full)
    azimuth = np.arctan2(points[:, 1], points[:, 0])
    inside = points[(azimuth > -0.5) & (azimuth < 0.7)]
    found = all_points(collect(log(), [0, 3], Placement("a", [mount], lidar=ahead), CROP))
    assert {tuple(p) for p in found} == {tuple(p) for p in inside}
    assert len(found) == len(inside) > 500
    none = collect(log(), [0, 3], Placement("a", [behind], lidar=ahead), CROP)
    assert len(all_points(none)) == 0


def test_ground_lies_at_zero_exactly():
    """A crop that starts at z = 0 must not lose ground to rounding."""
    placement = Placement("one", [Mount(z=2.2, pitch=0.1)], lidar=LIDAR)
    from_zero = collect(empty(), [0], placement, (0, -20, 0, 40, 20, 4))[0]
    from_below = collect(empty(), [0], placement, CROP)[0]
    np.testing.assert_array_equal(from_zero, from_below)
    assert (from_zero[:, 2] == 0).all()
    assert len(from_zero) > 500


def returns(mount: Mount, lidar: Lidar, seed: int = 0, parts=None) -> np.ndarray:
    """Points of one LiDAR before they are packed, everywhere."""
    none = bricks(np.empty((0, 7)), 0)
    hits = cast(mount, lidar, parts if parts is not None else none)
    points = np.empty((lidar.rays, 4), np.float32)
    white = Ground(np.ones((CELLS, CELLS), np.float32), (0.0, 0.0, 0.0))
    everywhere = (-200.0, -200.0, -50.0, 200.0, 200.0, 50.0)
    part = CloudPart((seed, 0, 0))
    return points[: sample_points(mount, lidar, hits, white, everywhere, part, points)]


@pytest.mark.parametrize("lost", [0.0, 0.6])
def test_range_noise_has_its_standard_deviation_along_the_ray(lost):
    """Also where the same ray draws whether it returns at all."""
    sd = 0.05
    mount = Mount(z=2.2)
    noisy = replace(LIDAR, range_noise=sd, azimuth_steps=5625, drop_off=lost)
    exact = returns(mount, replace(noisy, range_noise=0))
    error = (returns(mount, noisy) - exact)[:, :3].astype(np.float64)
    ray = (exact[:, :3] - mount.position) / np.linalg.norm(
        exact[:, :3] - mount.position, axis=1, keepdims=True
    )
    along = (error * ray).sum(axis=1)
    np.testing.assert_allclose(error, along[:, None] * ray, atol=1e-4)
    number = len(along)
    assert abs(along.mean()) < 4 * sd / math.sqrt(number)
    assert abs(along.std() - sd) < 4 * sd / math.sqrt(2 * number)
    for width, share in ((1, 0.682689), (2, 0.954500), (3, 0.997300)):
        found = (np.abs(along) < width * sd).mean()
        assert abs(found - share) < 4 * math.sqrt(share * (1 - share) / number)


def test_no_point_within_the_crop_is_lost_by_culling():
    """Of the noisy points, those in a small crop are the same whether it or all was cast."""
    noisy = replace(LIDAR, range_noise=0.1, drop_off=0.1)
    placement = Placement("two", TWO, lidar=noisy)
    small = (8.0, -8.0, 0.2, 24.0, 8.0, 3.0)

    def inner(crop) -> int:
        points = all_points(collect(log(), [0, 1, 2], placement, crop))[:, :3]
        low, high = np.array(small[:3]) + 0.01, np.array(small[3:]) - 0.01
        return int(((points > low) & (points < high)).all(axis=1).sum())

    everywhere = inner((-50.0, -50.0, -3.0, 50.0, 50.0, 9.0))
    assert everywhere > 300
    assert abs(inner(small) - everywhere) <= 2  # the two grids of coordinates differ


def test_drop_off_is_a_share_of_the_returns_and_differs_between_keys():
    kept = []
    number = len(all_points(collect(empty(2), [0, 1], Placement("a", TWO, LIDAR), CROP)))
    assert number > 1000
    for seed in (0, 1, 2**63 + 5):
        lossy = Placement("a", TWO, replace(LIDAR, drop_off=0.3))
        half = all_points(collect(empty(2), [0, 1], lossy, CROP, seed))
        assert abs(len(half) / number - 0.7) < 4 * math.sqrt(0.21 / number)
        kept.append(half)
    assert len({cloud.tobytes() for cloud in kept}) == 3


def test_no_frames_and_no_points():
    assert len(collect(log(), [], Placement("a", [Mount(z=2.2)], LIDAR), CROP)) == 0
    upwards = Placement("a", [Mount(z=2.2)], replace(LIDAR, elevations=(0.0, 0.2, 1.5)))
    assert collect(empty(), [0], upwards, CROP)[0].shape == (0, 4)


def test_a_return_at_range_zero_and_a_lidar_inside_an_object():
    """A sensor in the face of a brick meets it at once; noise takes no range below zero."""
    wall = bricks(np.array([[11.0, 0.0, 2.0, 2.0, 8.0, 4.0, 0.0]]), 0)
    ahead = Lidar((0.0,), azimuth_steps=1, range_noise=0.5)
    touching = returns(Mount(x=10.0, z=2.0), ahead, parts=wall)
    assert len(touching) == 1
    assert 10 <= touching[0, 0] < 13
    assert np.isfinite(touching).all()
    inside = returns(Mount(x=11.0, z=2.0), ahead, parts=wall)
    assert len(inside) == 0
    around = log().boxes[:1].assign(frame=0, x=0.0, y=0.0, z=2.0, length=9.0, width=9.0, height=9.0)
    clouds = collect(BoxLog(around, log().frames), [0], Placement("a", TWO, NOISY), CROP)
    assert np.isfinite(clouds[0]).all()


def with_building(pose: tuple[float, float, float]) -> BoxLog:
    """A wall 10 m before a vehicle at (100, 50) that looks along y, for the pose given."""
    frames = pd.DataFrame(
        [("a", 0, *pose)], columns=["scene", "frame", "ego_x", "ego_y", "ego_yaw"]
    )
    walls = [("a", 100.0, 61.0, 3, 30.0, 2.0, 6.0, 0), ("b", 100.0, 55.0, 3, 9.0, 2.0, 6.0, 0)]
    wall = pd.DataFrame(walls, columns=["scene", *GEOMETRY])
    return BoxLog(log().boxes[:0], frames, wall)


def test_buildings_of_the_scene_are_moved_into_the_ego_frame():
    placement = Placement("a", [Mount(z=2.2)], LIDAR)
    cloud = collect(with_building((100.0, 50.0, math.pi / 2)), [0], placement, CROP)[0]
    wall = cloud[cloud[:, 2] > 0.01]
    sign = wall[:, 0] < 9.99
    np.testing.assert_allclose(wall[~sign, 0], 10.0, atol=1e-3)
    np.testing.assert_allclose(wall[sign, 0], 9.95, atol=1e-3)
    assert sign.mean() < 0.05
    assert len(wall) > 200
    assert not (cloud[:, 0] > 10.001).any()  # it hides the ground
    away = collect(with_building((100.0, 50.0, -math.pi / 2)), [0], placement, CROP)[0]
    assert (away[:, 2] == 0).all()
    far = collect(with_building((3000.0, 50.0, math.pi / 2)), [0], placement, CROP)[0]
    free = collect(empty(), [0], placement, CROP)[0]
    np.testing.assert_array_equal(far[:, :3], free[:, :3])


def test_misaligned_heights_take_the_first_lidar_for_all():
    mounts = [Mount(z=2.2), Mount(z=2.7), Mount(x=0.5, z=2.0)]
    tall = (0.0, -20.0, -2.0, 40.0, 20.0, 6.0)
    placement = Placement("a", mounts, lidar=LIDAR)
    right = collect(log(), [1], placement, tall)
    wrong = collect(log(), [1], placement, tall, misaligned_heights=True)
    for m, mount in enumerate(mounts):
        low, high = tall[2] + 0.6, tall[5] - 0.6  # what neither crop cuts
        lift = mounts[0].z - mount.z
        a, b = (c[0][c.lidar(0) == m] for c in (right, wrong))
        a = a[(a[:, 2] > low) & (a[:, 2] < high)]
        b = b[(b[:, 2] - lift > low) & (b[:, 2] - lift < high)]
        a[:, 2] += lift
        np.testing.assert_allclose(b, a, atol=2 * GRID_M + 1e-5)
    sunk = collect(log(), [1], placement, (0.0, -20.0, -0.51, 40.0, 20.0, -0.49), 0, True)
    assert (sunk.lidar(0) == 1).all()
    assert len(sunk[0]) > 100


def test_wrong_input_is_named():
    placement = Placement("a", [Mount(z=2.2)], LIDAR)
    bad = log().boxes.assign(x=lambda t: t["x"].where(t.index != 3))
    with refused(("row 3", "x", "")):
        collect(BoxLog(bad, log().frames), [0], placement, CROP)
    with refused(("frames: frame 0", "", "nan")):
        collect(with_building((100.0, math.nan, 0.0)), [0], placement, CROP)
    no_pose = with_building((0.0, 0.0, 0.0))
    frames = no_pose.frames.drop(columns="ego_yaw")
    no_pose = BoxLog(no_pose.boxes, frames, no_pose.buildings)
    with refused(("frames", "ego_yaw", "")):
        collect(no_pose, [0], placement, CROP)
    twice = BoxLog(log().boxes, pd.concat([log().frames, log().frames[:1]]))
    with refused(("box log: frames", "frame", "")):
        collect(twice, [0], placement, CROP)


def test_normal_numbers_are_quantiles_of_the_uniform_ones():
    """The largest error bounds them, and they agree with scipy's."""
    special = pytest.importorskip("scipy.special")
    from numba import njit

    from lidarplace.clouds.returns import _fill_normals

    fill = njit(lambda numbers, flank: _fill_normals(numbers, len(numbers), flank))
    tails = 2.0 ** -np.arange(2, 54)
    uniform = np.concatenate([(np.arange(10**5) + 0.5) / 10**5, tails, 1 - tails])
    normal = uniform.copy()
    fill(normal, np.empty(len(normal), np.uint32))
    np.testing.assert_allclose(normal, special.ndtri(uniform), rtol=2e-7, atol=1e-12)
    assert np.abs(normal).max() < LARGEST_ERROR


def test_mounting_errors_are_of_each_frame_and_those_of_the_rig_as_it_is_drawn():
    errors = MountingErrors(0.01, math.radians(0.5))
    rig = Placement("two", TWO, replace(NOISY, size=(0.3, 0.3, 0.3)))  # one hides the other
    found = collect(log(), range(6), rig, CROP, seed=3, errors=errors)
    for frame in range(6):
        alone = collect(log(), [frame], errors.drawn(rig, 3, frame), CROP, seed=3)
        np.testing.assert_array_equal(found[frame], alone[0])
    exact = collect(log(), range(6), rig, CROP, seed=3)
    assert not np.array_equal(found[0], exact[0])
    portion = collect(log(), range(1, 6, 2), rig, CROP, seed=3, errors=errors)
    np.testing.assert_array_equal(portion[1], found[3])


def test_rigs_that_share_surroundings_have_the_clouds_of_each_alone(monkeypatch):
    """Also of frames whose parts are not kept, as there are too many."""
    monkeypatch.setattr("lidarplace.clouds.surroundings._MOST_PARTS", 20)
    shared, how = Surroundings(log(), 7), {"seed": 7, "errors": MountingErrors(0.01, 0.01)}
    for mounts in (TWO, TWO[:1], [Mount(z=2.0)]):
        rig = Placement("any", mounts, lidar=NOISY)
        clouds = SimulatedClouds(shared, range(6), rig, CROP, **how)
        for frame, alone in enumerate(collect(log(), range(6), rig, CROP, **how)):
            np.testing.assert_array_equal(clouds[frame], alone)
    with refused("seed: expected 7, found 0"):
        SimulatedClouds(shared, [0], rig, CROP)


def test_scenes_of_several_frames_are_those_of_each():
    rig = Placement("two", TWO, lidar=NOISY)
    clouds = SimulatedClouds(log(), [4, 1, 3], rig, CROP)
    for frame, scene in zip((4, 1, 3), clouds.scenes(range(3)), strict=True):
        expected = SimulatedClouds(log(), [frame], rig, CROP).scene(0)
        assert (expected.parts.owner >= 0).any()
        assert (expected.parts.owner <= PANE).any()
        for name, array in vars(expected.parts).items():
            np.testing.assert_array_equal(getattr(scene.parts, name), array, strict=True)
    assert clouds.scenes([]) == []
