"""Numbers beyond their range are refused, by commands and by functions."""

import math

import pytest

from lidarplace import Lidar, Roi
from lidarplace.base.ranges import FRAMES, LIDAR_HEIGHT
from lidarplace.clouds.clouds import Crop
from lidarplace.scenes.kitti.read import read_kitti
from lidarplace.scenes.kitti.velodyne import read_kitti_clouds

WIDE: Crop = (-50.0, -50.0, -3.0, 50.0, 50.0, 5.0)


@pytest.mark.parametrize("value", [math.nan, math.inf, -1e-9, 100.1])
def test_a_height_is_one(tmp_path, value):
    with pytest.raises(ValueError, match=r"the height of the LiDAR must be within 0\.0 and 100\.0"):
        LIDAR_HEIGHT.check("the height of the LiDAR", value)
    with pytest.raises(ValueError, match="the height of the LiDAR"):
        read_kitti(tmp_path, lidar_height=value)
    with pytest.raises(ValueError, match="the height of the LiDAR"):
        read_kitti_clouds(tmp_path, [0], WIDE, lidar_height=value)


def test_both_ends_are_allowed():
    for value in (FRAMES.low, FRAMES.high):
        FRAMES.check("frames", value)


def test_a_lidar_and_a_region_that_no_memory_holds():
    with pytest.raises(ValueError, match="azimuth_steps must be within 1 and 1,000,000, found 0"):
        Lidar((0.0,), 0)
    with pytest.raises(ValueError, match="azimuth_steps must be within"):
        Lidar((0.0,), 999_999_999_999)
    with pytest.raises(ValueError, match=r"voxels of 4\.94066e-324 m; allowed are"):
        Roi((0, 40), (-20, 20), (0, 4), 5e-324)
