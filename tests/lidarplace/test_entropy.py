import math

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidarplace.pog.occupancy.entropy import binary_entropy


def exact(count, frames=1):
    """H of a share, from many digits."""
    with mpmath.workdps(400):
        share = mpmath.mpf(count) / frames
        if share in (0, 1):
            return 0.0
        return float(-share * mpmath.log(share) - (1 - share) * mpmath.log(1 - share))


@pytest.mark.parametrize(
    "small", [1e-16, 2.0**-53, 1e-17, 1e-100, 1e-300, 1e-308, 5e-324, 1e-3, 0.25, 0.4999, 0.5]
)
def test_both_extremes_against_mpmath(small):
    found = binary_entropy([small, 1 - small], [1 - small, small])
    np.testing.assert_array_max_ulp(found, np.full(2, exact(small)), maxulp=2)


def test_nothing_is_uncertain_at_0_and_1():
    assert binary_entropy([0.0, 1.0], [1.0, 0.0]).tolist() == [0.0, 0.0]
    assert math.copysign(1, float(binary_entropy(0.0, 1.0))) == 1


@given(st.integers(1, 10**7), st.integers(0, 10**7))
def test_shares_of_frames_against_mpmath(frames, count):
    count = min(count, frames)
    p, rest = count / frames, (frames - count) / frames
    expected = np.float64(exact(count, frames))
    np.testing.assert_array_max_ulp(binary_entropy(p, rest), expected, maxulp=4)
    assert binary_entropy(p, rest) == binary_entropy(rest, p)
