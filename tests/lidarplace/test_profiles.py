"""Profiles: what the paper says and what its code does, together and one by one."""

import math

import numpy as np
import pytest

from lidarplace import PAPER_PLACEMENTS
from lidarplace.clouds.profiles import PROFILES, Profile, with_tilt_in_degrees
from lidarplace.rigs.lidar import Lidar


def test_points_of_a_frame():
    assert PROFILES["paper"].lidar.rays == 90_000
    assert PROFILES["released-code"].lidar.rays == 4_000
    for profile in PROFILES.values():
        np.testing.assert_allclose(np.degrees(profile.lidar.elevations), np.linspace(-25, 5, 16))


def test_tilts_are_taken_for_degrees():
    placement = PAPER_PLACEMENTS["pyramid_roll"]
    released = with_tilt_in_degrees(placement)
    for before, after in zip(placement.mounts, released.mounts, strict=True):
        assert after.roll == pytest.approx(math.radians(before.roll))
        assert (before.x, before.y, before.z, before.yaw) == (after.x, after.y, after.z, after.yaw)
    assert released.mounts[3].roll == pytest.approx(0.0048869, abs=1e-7)
    pitched = with_tilt_in_degrees(PAPER_PLACEMENTS["pyramid_pitch"])
    assert pitched.mounts[1].pitch == pytest.approx(0.09 * math.pi / 180)


def test_a_quirk_alone():
    placement = PAPER_PLACEMENTS["line_roll"]
    assert PROFILES["paper"].placement(placement) == placement
    sparse = Profile(PROFILES["released-code"].lidar)
    assert sparse.placement(placement) == placement
    tilted = Profile(Lidar.paper(), tilt_in_degrees=True).placement(placement)
    assert tilted == with_tilt_in_degrees(placement)
    everything = PROFILES["released-code"]
    assert everything.misaligned_heights
    assert everything.placement(placement) == tilted
