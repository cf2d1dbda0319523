"""Packed clouds: exact to the grid, readable frame by frame, honest about what does not fit."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from lidarplace.clouds.clouds import JoinedClouds, PointClouds, read_clouds, write_clouds

CROP = (0.0, -20.0, -0.5, 40.0, 20.0, 4.0)


def random_points(seed: int, number: int, crop=CROP) -> np.ndarray:
    rng = np.random.default_rng(seed)
    low, high = np.array([*crop[:3], 0.0]), np.array([*crop[3:], 1.0])
    return rng.uniform(low, high, (number, 4)).astype(np.float32)


def packed(*numbers: int, first: int = 0) -> tuple[PointClouds, list[np.ndarray]]:
    clouds = [random_points(n, n) for n in numbers]
    split = [(points, [len(points) // 3, len(points) - len(points) // 3]) for points in clouds]
    frames = first + 7 * np.arange(len(numbers))
    return PointClouds.from_frames(frames, split, CROP), clouds


def test_every_point_comes_back_to_half_a_millimetre():
    clouds, points = packed(1000, 0, 17, 1)
    assert len(clouds) == 4
    assert clouds.frames.tolist() == [0, 7, 14, 21]
    assert clouds.lidar(2).tolist() == [0] * 5 + [1] * 12
    assert clouds.lidar(2).dtype == np.uint8
    assert clouds.lidar(1).tolist() == list(PointClouds.from_frames([], [], CROP)) == []
    for index in (-1, 4):
        with pytest.raises(IndexError, match=r"outside 0\.\.3"):
            clouds[index]
    for found, expected in zip(clouds, points, strict=True):
        assert found.dtype == np.float32
        np.testing.assert_allclose(found[:, :3], expected[:, :3], atol=0.0005 + 4e-6, rtol=0)
        np.testing.assert_allclose(found[:, 3], expected[:, 3], atol=1 / 510 + 1e-7)


corner = arrays(
    np.float32, st.tuples(st.integers(0, 40), st.just(4)), elements=st.floats(0, 1, width=32)
)


@given(shares=corner, size=st.sampled_from([1e-3, 1.0, 65.535, 300.0]))
@settings(max_examples=100, derandomize=True)
def test_any_jump_within_any_region(shares, size):
    """From corner to corner, where differences overflow 16 bits, and in wide regions."""
    crop = (-size, 0.0, 0.0, 0.0, size, size)
    points = shares * np.array([size, size, size, 1], np.float32)
    points[:, 0] -= np.float32(size)
    points = np.clip(points, np.float32([*crop[:3], 0]), np.float32([*crop[3:], 1]))
    step = max(0.001, size / 65535)
    clouds = PointClouds.from_frames([3], [(points, [len(points)])], crop)
    assert float(clouds.step) == pytest.approx(step)
    np.testing.assert_allclose(clouds[0][:, :3], points[:, :3], atol=step / 2 + 4e-5, rtol=0)


def test_what_lies_on_the_grid_is_exact():
    points = np.array([[0, -20, 0, 1], [40, 20, 4, 0], [12.345, 0.001, 0, 0.2]], np.float32)
    clouds = PointClouds.from_frames([0], [(points, [3])], CROP)
    np.testing.assert_array_equal(clouds[0], points)


def test_files_hold_the_same_and_stay_on_disk(tmp_path):
    clouds, _ = packed(100, 0, 50)
    write_clouds(tmp_path / "c", clouds)
    read = read_clouds(tmp_path / "c")
    assert isinstance(read.data, np.memmap)
    for name, array in clouds.arrays().items():
        np.testing.assert_array_equal(getattr(read, name), array)
    np.testing.assert_array_equal(read[2], clouds[2])
    assert not [path for path in (tmp_path / "c").iterdir() if path.suffix != ".npy"]


def test_joined_clouds_follow_each_other():
    (a, _), (b, _) = packed(5, 6), packed(7, first=100)
    joined = JoinedClouds([a, b])
    assert joined.frames.tolist() == [0, 7, 100]
    assert [len(points) for points in joined] == [5, 6, 7]
    np.testing.assert_array_equal(joined[2], b[0])
    for index in (-1, 3):
        with pytest.raises(IndexError, match="frame index"):
            joined[index]
