"""Numbers beyond their range are refused, by commands and by functions."""

import math

import pytest
from typer.testing import CliRunner

from lidarplace import Lidar, Roi
from lidarplace.base.ranges import FRAMES, LIDAR_HEIGHT
from lidarplace.clouds.clouds import Crop
from lidarplace.commands.convert import app as convert
from lidarplace.commands.export import app as export
from lidarplace.commands.view import app as view
from lidarplace.plugins.carla.command import app as carla
from lidarplace.scenes.kitti.read import read_kitti
from lidarplace.scenes.kitti.velodyne import read_kitti_clouds
from sweeps.commands.accuracy import app as accuracy

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


@pytest.mark.parametrize(
    ("app", "arguments"),
    [
        (convert, ["kitti", "in", "out", "--lidar-height", "inf"]),
        (convert, ["kitti", "in", "out", "--lidar-height", "nan"]),
        (convert, ["nuscenes", "in", "out", "--test-share", "nan"]),
        (export, ["log", "out", "--placement", "line", "--seed", "-1"]),
        (export, ["log", "out", "--placement", "line", "--seed", "18446744073709551616"]),
        (view, ["log", "--frame", "1000000000000000000000000000000"]),
        (accuracy, ["boxes.csv", "--frames", "-1"]),
        (accuracy, ["boxes.csv", "--frames", "99999999999999"]),
        (accuracy, ["boxes.csv", "--azimuth-steps", "999999999999"]),
        (accuracy, ["boxes.csv", "--azimuth-steps", "0"]),
        (accuracy, ["boxes.csv", "--resolution", "nan"]),
        (accuracy, ["boxes.csv", "--resolution", "0.1", "--resolution", "5e-324"]),
        (accuracy, ["boxes.csv", "--frames-share", "nan"]),
        (carla, ["town.yaml", "out", "--port", "0"]),
        (carla, ["town.yaml", "out", "--timeout", "inf"]),
    ],
)
def test_an_option_names_itself(app, arguments):
    option = next(word for word in arguments if word.startswith("--") and word != "--placement")
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 2
    assert done.stderr.startswith(f"{option}: must be within ")
    assert done.stderr.count("\n") == 1


def test_a_lidar_and_a_region_that_no_memory_holds():
    with pytest.raises(ValueError, match="azimuth_steps must be within 1 and 1,000,000, found 0"):
        Lidar((0.0,), 0)
    with pytest.raises(ValueError, match="azimuth_steps must be within"):
        Lidar((0.0,), 999_999_999_999)
    with pytest.raises(ValueError, match=r"voxels of 4\.94066e-324 m; allowed are"):
        Roi((0, 40), (-20, 20), (0, 4), 5e-324)
