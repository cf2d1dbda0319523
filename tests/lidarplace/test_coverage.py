"""The coverage methods against each other."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace import PAPER_PLACEMENTS, Lidar, Mount, Placement, Roi
from lidarplace.coverage import count_covered, coverage

ROI = Roi(x=(0.0, 3.0), y=(-1.5, 1.5), z=(0.0, 2.0), resolution=0.25)
LIDAR = Lidar(tuple(np.radians([-60.0, -25.0, -3.0, 0.0, 5.0, 40.0])), azimuth_steps=720)
right_angle = math.pi / 2
angle = st.one_of(st.floats(-right_angle, right_angle), st.sampled_from([0.0, right_angle]))
# Positions on voxel corners and faces, inside and outside the ROI, and anywhere.
mounts = st.builds(
    Mount,
    st.floats(-4, 6) | st.sampled_from([0.0, 0.5, 1.25]),
    st.floats(-4, 4) | st.sampled_from([-1.5, 0.0, 0.25]),
    st.floats(-3, 6) | st.sampled_from([0.0, 1.0, 2.0]),
    *[angle] * 2,
    st.floats(-math.pi, math.pi),
)


@given(
    mounts,
    st.one_of(st.just((-math.pi, math.pi)), st.just((-0.7, 0.9)), st.just((2.0, 7.0))),
    st.one_of(st.just(100.0), st.floats(0.3, 4.0)),
)
@settings(max_examples=100)
def test_traversed_voxels_are_covered_by_the_cones(mount, azimuth, reach):
    lidar = Lidar(LIDAR.elevations, LIDAR.azimuth_steps, range=reach, azimuth=azimuth)
    placement = Placement("one", [mount], lidar=lidar)
    traversed = coverage(placement, ROI, "dda")
    assert not (traversed & ~coverage(placement, ROI, "cone")).any()


@pytest.mark.parametrize(("azimuth", "reach"), [((-math.pi, math.pi), 100.0), ((-0.7, 0.9), 1.7)])
def test_traversal_converges_to_the_cones(azimuth, reach):
    placement, missing = PAPER_PLACEMENTS["line_roll"], []
    for steps in (90, 360, 1440, 5760, 92160):
        lidar = Lidar(placement.lidar.elevations, steps, reach, azimuth=azimuth)
        traced = placement.with_lidar(lidar)
        exact = count_covered(traced, ROI, "cone")
        missing.append(exact - count_covered(traced, ROI, "dda"))
    assert missing == sorted(missing, reverse=True)
    assert 0 <= missing[-1] <= 0.002 * exact
    assert missing[0] > 0.02 * exact
