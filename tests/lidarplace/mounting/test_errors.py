"""Mounting errors: bounded, alike for all rigs, and what clouds make of them."""

import math
from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lidarplace import PAPER_PLACEMENTS, Lidar, Mount, Placement
from lidarplace.mounting.errors import MountingErrors

HALF_A_DEGREE = MountingErrors(0.01, math.radians(0.5))
ANGLES = st.floats(-math.pi, math.pi)
PITCH = st.sampled_from([-math.pi / 2, math.pi / 2]) | ANGLES
MOUNTS = st.builds(Mount, *[st.floats(-3, 3)] * 3, ANGLES, PITCH, ANGLES)


def shifts(rig, errors, *key):
    """Offsets and rotation vectors in the ego frame, (mounts, 6)."""
    pairs = zip(errors.drawn(rig, *key).mounts, rig.mounts, strict=True)
    return np.array([[*(d.position - m.position), *turn(d, m)] for d, m in pairs])


def turn(drawn, mount):
    """Return the turn from the mount's rotation to the drawn one, by scipy's angles."""
    after, before = (Rotation.from_euler("ZYX", [m.yaw, m.pitch, m.roll]) for m in (drawn, mount))
    return (after * before.inv()).as_rotvec()


@given(MOUNTS, st.integers(0, 2**31), st.floats(0, 1), st.floats(0, 0.1))
def test_no_mount_is_off_by_more_than_said(mount, frame, offset, angle):
    errors = MountingErrors(offset, angle)
    offsets = np.abs(shifts(Placement("one", [mount], Lidar.paper()), errors, frame))
    assert (offsets <= np.repeat([offset, angle], 3) + 1e-14).all()


@given(MOUNTS, st.integers(0, 2**31))
def test_without_an_error_a_mount_is_as_it_was(mount, frame):
    rig = Placement("one", [mount], Lidar.paper())
    assert MountingErrors().drawn(rig, frame) == rig
    (drawn,) = MountingErrors(0.1).drawn(rig, frame).mounts
    assert replace(drawn, x=mount.x, y=mount.y, z=mount.z) == mount


@given(MOUNTS, MOUNTS)
def test_all_rigs_of_a_vehicle_are_off_alike_and_vehicles_differ(one, two):
    line = PAPER_PLACEMENTS["line"]
    any_two = Placement("any", [one, replace(two, z=one.z + 1)], Lidar.paper())
    off = shifts(line, HALF_A_DEGREE, 3, 7)
    # However many LiDARs a rig has.
    np.testing.assert_allclose(shifts(any_two, HALF_A_DEGREE, 3, 7), off[:2], rtol=0, atol=1e-14)
    other = shifts(line, HALF_A_DEGREE, 3, 8)
    assert (np.abs(off - other) > 1e-6).any(axis=1).all()


def test_a_rig_is_drawn_anew_from_its_key_each_time():
    line = PAPER_PLACEMENTS["line"]
    for _ in range(2):  # the second time numbers are those of the first
        for number, mount in enumerate(HALF_A_DEGREE.drawn(line, 3, 7).mounts):
            random = np.random.default_rng((3, 7, number))
            assert mount == HALF_A_DEGREE.displaced(line.mounts[number], random)


@settings(max_examples=5)
@given(MOUNTS)
def test_errors_spread_alike_along_every_axis(mount):
    random = np.random.default_rng(0)
    off = [HALF_A_DEGREE.displaced(mount, random) for _ in range(1000)]
    offsets = np.array([[*(d.position - mount.position), *turn(d, mount)] for d in off])
    shares = offsets / np.repeat([HALF_A_DEGREE.offset, HALF_A_DEGREE.angle], 3)
    assert np.abs(shares.mean(axis=0)).max() < 5 / math.sqrt(3 * 1000)  # five sigma
    assert np.abs(shares.var(axis=0) - 1 / 3).max() < 5 * math.sqrt(4 / 45 / 1000)
