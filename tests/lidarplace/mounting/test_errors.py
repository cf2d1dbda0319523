"""Mounting errors: bounded, alike for all rigs, and what clouds make of them."""

import math
from dataclasses import astuple, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidarplace import PAPER_PLACEMENTS
from lidarplace.mounting.errors import MountingErrors

HALF_A_DEGREE = MountingErrors(0.01, math.radians(0.5))


def shifts(rig, errors, *key):
    drawn = errors.drawn(rig, *key)
    return np.array([astuple(m) for m in drawn.mounts]) - [astuple(m) for m in rig.mounts]


@given(st.integers(0, 2**31), st.floats(0, 1), st.floats(0, 0.1))
def test_no_mount_is_off_by_more_than_said(frame, offset, angle):
    found = np.abs(shifts(PAPER_PLACEMENTS["line_roll"], MountingErrors(offset, angle), frame))
    assert (found <= np.repeat([offset, angle], 3) + 1e-15).all()


def test_all_rigs_of_a_vehicle_are_off_alike_and_vehicles_differ():
    line, center = (
        shifts(PAPER_PLACEMENTS[name], HALF_A_DEGREE, 3, 7) for name in ("line", "center")
    )
    np.testing.assert_allclose(line, center, rtol=0, atol=1e-15)
    other = shifts(PAPER_PLACEMENTS["line"], HALF_A_DEGREE, 3, 8)
    assert (np.abs(line - other) > 1e-6).any(axis=1).all()
    one = replace(PAPER_PLACEMENTS["line"], mounts=PAPER_PLACEMENTS["line"].mounts[:1])
    np.testing.assert_array_equal(shifts(one, HALF_A_DEGREE, 3, 7), line[:1])  # however many follow


def test_every_coordinate_is_spread_evenly():
    found = np.stack([shifts(PAPER_PLACEMENTS["line"], HALF_A_DEGREE, k) for k in range(2000)])
    shares = found / np.repeat([HALF_A_DEGREE.offset, HALF_A_DEGREE.angle], 3)
    assert np.abs(shares.mean(axis=0)).max() < 5 / math.sqrt(3 * 2000)  # five sigma
    assert np.abs(shares.var(axis=0) - 1 / 3).max() < 5 * math.sqrt(4 / 45 / 2000)


@pytest.mark.parametrize("wrong", [{"offset": -0.1}, {"angle": math.nan}, {"angle": math.inf}])
def test_impossible_errors_are_refused(wrong):
    with pytest.raises(ValueError, match="mounting errors need finite offset and angle"):
        MountingErrors(**wrong)
