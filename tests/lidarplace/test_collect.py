"""Point clouds of placements: independence of portions, noise, drop-off, crop."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from lidarplace.boxes import GEOMETRY
from lidarplace.lidar.collect import collect
from lidarplace.lidar.raycast import GROUND, OWN_BODY, cast
from lidarplace.lidar.returns import ATTENUATION_PER_M
from lidarplace.placement import Mount, Placement
from lidarplace.sensor import Lidar

CROP = (0.0, -20.0, -1.0, 40.0, 20.0, 4.0)
LIDAR = Lidar(tuple(np.radians(np.linspace(-25, 5, 8))), azimuth_steps=900)
NOISY = replace(LIDAR, range_noise=0.05, drop_off=0.2)
TWO = [Mount(y=0.5, z=2.2, roll=0.28), Mount(x=0.5, z=2.4, yaw=1.0)]


def log(frames: int = 6, per_frame: int = 8) -> pd.DataFrame:
    rng = np.random.default_rng(5)
    rows = frames * per_frame
    table = pd.DataFrame(rng.uniform(1.5, 4, (rows, 7)), columns=list(GEOMETRY))
    table["x"], table["y"], table["z"] = (
        rng.uniform(6, 35, rows),
        rng.uniform(-18, 18, rows),
        table["height"] / 2,
    )
    table.insert(0, "frame", np.repeat(np.arange(frames), per_frame))
    table.insert(1, "class", "Car")
    return table.sample(frac=1, random_state=1, ignore_index=True)


def test_portions_and_order_of_frames_change_nothing():
    placement = Placement("two", TWO, lidar=NOISY)
    whole = collect(log(), [0, 1, 2, 3, 4, 5], placement, CROP, seed=7)
    assert len(whole) == 6
    for frames in ([4, 1], [5], [2, 0, 3]):
        part = collect(log(), frames, placement, CROP, seed=7)
        for i, frame in enumerate(frames):
            np.testing.assert_array_equal(part[i], whole[frame])


def test_index_of_the_lidar_is_kept():
    both = collect(log(), [0, 3], Placement("two", TWO, lidar=LIDAR), CROP)
    for m, mount in enumerate(TWO):
        alone = collect(log(), [0, 3], Placement("one", [mount], lidar=LIDAR), CROP)
        np.testing.assert_array_equal(both.points[both.lidar == m], alone.points)
    assert both.lidar.dtype == np.uint8
    assert both.points.dtype == np.float32


def test_points_are_the_hits_within_the_crop():
    boxes, mount = log(), TWO[0]
    geometry = boxes[boxes["frame"] == 2][list(GEOMETRY)].to_numpy()
    hits = cast(mount, LIDAR, geometry)
    kept = hits.target >= GROUND
    points = mount.position + hits.range[kept, None] * (LIDAR.directions() @ mount.rotation.T)[kept]
    inside = ((points >= CROP[:3]) & (points <= CROP[3:])).all(axis=1)
    intensity = hits.incidence[kept] * np.exp(-ATTENUATION_PER_M * hits.range[kept])
    cloud = collect(boxes, [2], Placement("one", [mount], lidar=LIDAR), CROP)[0]
    np.testing.assert_allclose(cloud[:, :3], points[inside], atol=1e-5)
    np.testing.assert_allclose(cloud[:, 3], intensity[inside], rtol=1e-5)


def test_points_of_a_field_of_view_are_those_of_the_whole_turn_within_it():
    ahead = replace(LIDAR, azimuth=(-0.5, 0.7))
    mount, behind = Mount(z=2.2), Mount(z=2.2, yaw=math.pi)
    full = collect(log(), [0, 3], Placement("a", [mount], lidar=LIDAR), CROP)
    azimuth = np.arctan2(full.points[:, 1], full.points[:, 0])
    inside = full.points[(azimuth > -0.5) & (azimuth < 0.7)]
    found = collect(log(), [0, 3], Placement("a", [mount], lidar=ahead), CROP)
    assert {tuple(p) for p in found.points} == {tuple(p) for p in inside}
    assert len(found.points) == len(inside) > 500
    none = collect(log(), [0, 3], Placement("a", [behind], lidar=ahead), CROP)
    assert len(none.points) == 0


def test_ground_lies_at_zero_exactly():
    """A crop that starts at z = 0 must not lose ground to rounding."""
    placement = Placement("one", [Mount(z=2.2, pitch=0.1)], lidar=LIDAR)
    empty = log()[:0]
    from_zero = collect(empty, [0], placement, (0, -20, 0, 40, 20, 4))
    from_below = collect(empty, [0], placement, CROP)
    np.testing.assert_array_equal(from_zero.points, from_below.points)
    assert (from_zero.points[:, 2] == 0).all()
    assert len(from_zero.points) > 500


def test_range_noise_has_its_standard_deviation_along_the_ray():
    sd = 0.05
    mount = Mount(z=2.2)
    everywhere = (-200.0, -200.0, -50.0, 200.0, 200.0, 50.0)
    noisy = replace(LIDAR, range_noise=sd, azimuth_steps=5625)
    exact = collect(
        log()[:0], [0], Placement("a", [mount], replace(noisy, range_noise=0)), everywhere
    )[0]
    points = collect(log()[:0], [0], Placement("a", [mount], noisy), everywhere)[0]
    error = (points - exact)[:, :3].astype(np.float64)
    ray = (exact[:, :3] - mount.position) / np.linalg.norm(
        exact[:, :3] - mount.position, axis=1, keepdims=True
    )
    along = (error * ray).sum(axis=1)
    np.testing.assert_allclose(error, along[:, None] * ray, atol=1e-4)
    number = len(along)
    assert abs(along.mean()) < 4 * sd / math.sqrt(number)
    assert abs(along.std() - sd) < 4 * sd / math.sqrt(2 * number)
    inner = (np.abs(along) < sd).mean()
    assert abs(inner - 0.6827) < 4 * math.sqrt(0.6827 * 0.3173 / number)


def test_drop_off_is_a_share_of_the_returns_and_differs_between_keys():
    kept = []
    full = collect(log(), [0, 1], Placement("a", TWO, LIDAR), CROP)
    for seed in (0, 1, 2**63 + 5):
        half = collect(log(), [0, 1], Placement("a", TWO, replace(LIDAR, drop_off=0.3)), CROP, seed)
        number = len(full.points)
        assert abs(len(half.points) / number - 0.7) < 4 * math.sqrt(0.21 / number)
        kept.append(half.points)
    assert len({cloud.tobytes() for cloud in kept}) == 3


def test_own_body_returns_nothing():
    inside_body = (*(OWN_BODY[k] - OWN_BODY[3 + k] / 2 for k in range(2)), 0.1, 2.3, 0.95, 1.6)
    clouds = collect(log()[:0], [0], Placement("a", [Mount(z=2.2)], LIDAR), inside_body)
    assert len(clouds.points) == 0


def test_a_frame_without_boxes_shows_the_ground_and_no_frames_no_points():
    placement = Placement("a", [Mount(z=2.2)], LIDAR)
    clouds = collect(log(), [99], placement, CROP)
    assert len(clouds[0]) > 500
    none = collect(log(), [], placement, CROP)
    assert none.points.shape == (0, 4)
    np.testing.assert_array_equal(none.offsets, [0])


def test_wrong_input_is_named():
    placement = Placement("a", [Mount(z=2.2)], LIDAR)
    with pytest.raises(ValueError, match="crop needs x0 < x1"):
        collect(log(), [0], placement, (40.0, -20.0, 0.0, 0.0, 20.0, 4.0))
    with pytest.raises(ValueError, match="row 3: x must be a finite number"):
        collect(log().assign(x=lambda t: t["x"].where(t.index != 3)), [0], placement, CROP)
    many = Placement("many", [Mount(x=i * 0.001, z=2.2) for i in range(257)], LIDAR)
    with pytest.raises(ValueError, match="at most 256 LiDARs, found 257"):
        collect(log(), [0], many, CROP)
