"""Clouds cast by the kernels of GPUs are those of the CPU, return by return."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from lidarplace.clouds.clouds import JoinedClouds
from lidarplace.clouds.collect import SimulatedClouds
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.mounting.errors import MountingErrors
from lidarplace.rigs.correction import Correction, Mask
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement
from lidarplace.rigs.scan_pattern import ScanPattern
from tests.lidarplace.test_collect import log
from tests.training.other_device import other_device
from training.casting import points_on
from training.ops.gpu import casting

CROP = (-10.0, -20.0, -0.5, 40.0, 20.0, 4.0)
LIDAR = Lidar(
    tuple(np.radians(np.linspace(-25, 5, 8))), azimuth_steps=250, range_noise=0.05, drop_off=0.1
)


@pytest.fixture
def device(monkeypatch):
    monkeypatch.setattr(casting, "_RAYS", 1024)
    with other_device() as place, np.errstate(all="ignore"):
        yield place


def log_of(frames: int, objects: int, buildings: bool = False) -> BoxLog:
    random = log(frames, objects, (-8, 30), (3, 18))
    if not buildings:
        return random
    poses = random.frames.assign(ego_x=100.0, ego_y=50.0, ego_yaw=0.3)
    walls = pd.DataFrame([("a", 104, 75, 3, 30, 2, 6.0, 0.2)], columns=["scene", *GEOMETRY])
    return BoxLog(random.boxes, poses, walls)


def check_equal(device, clouds, frames: int) -> None:
    """Compare all coordinates and intensities with those of the CPU."""
    points = points_on(device, clouds, range(frames))
    assert len(points) == frames
    for index, cloud in enumerate(points):
        assert cloud.device == device
        assert len(cloud) > 200
        np.testing.assert_array_equal(cloud.held.numpy(), clouds[index])


def test_tilted_lidars_of_several_frames_and_logs(device):
    """Noise, drop-off, height errors, a wall, and rays that end at the other LiDAR."""
    mounts = [Mount(y=0.5, z=2.2, roll=0.28), Mount(x=0.5, z=2.5, yaw=1.0)]
    rig = Placement("two", mounts, lidar=replace(LIDAR, size=(0.3, 0.3, 0.3)))
    logs = (log_of(3, 4), [2, 0]), (log_of(1, 2, buildings=True), [0])
    parts = [SimulatedClouds(*log, rig, CROP, 2**63 + 5, True) for log in logs]
    assert any(len(ends) for ends in parts[0].scene(0).ends)
    check_equal(device, JoinedClouds(parts), 3)


def test_fog_dark_surfaces_a_correction_and_offset_lasers(device):
    mask = Mask(((1.0, 0.5), (0.4, 0.9)), (-0.1,))
    correction = Correction((("Car", 0.5), ("other", 0.8)), 30.0, mask)
    lidar = replace(
        LIDAR, range_10=25.0, range_80=60.0, min_range=2.0, extinction=0.02, window=0.9,
        correction=correction, offsets=(0.0,) * 4 + (0.1,) * 4,
    )  # fmt: skip
    rig = Placement("one", [Mount(x=0.2, z=2.2, pitch=0.05)], lidar=lidar)
    clouds = SimulatedClouds(log_of(1, 5), [0], rig, CROP)
    plain = SimulatedClouds(log_of(1, 5), [0], rig.with_lidar([LIDAR]), CROP)
    assert len(clouds[0]) < 0.9 * len(plain[0])
    check_equal(device, clouds, 1)


def test_patterns_and_mounting_errors_of_each_frame(device):
    random = np.random.default_rng(2)
    angles = random.uniform(-math.pi, math.pi, 3000), random.uniform(-0.4, 0.1, 3000)
    lidar = replace(Lidar.patterned(ScanPattern(*angles, 1000)), range_noise=0.02)
    rig = Placement("pattern", [Mount(z=2.2, yaw=0.4)], lidar=lidar)
    errors = MountingErrors(0.01, math.radians(0.5))
    check_equal(device, SimulatedClouds(log_of(2, 4), [0, 1], rig, CROP, errors=errors), 2)


def test_no_parts_and_no_returns(device):
    rig = Placement("up", [Mount(z=2.2)], lidar=replace(LIDAR, elevations=(0.1, 0.2)))
    clouds = SimulatedClouds(log_of(1, 1), [0], rig, CROP)
    clouds._body = clouds._body.__class__(*(array[:0] for array in vars(clouds._body).values()))
    (points,) = points_on(device, clouds, range(1))
    np.testing.assert_array_equal(points.held.numpy(), clouds[0])
