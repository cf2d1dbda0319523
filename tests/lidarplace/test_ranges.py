"""Both ends of a range are allowed; `tests/data/messages.txt` has what is beyond them."""

from lidarplace.base.ranges import FRAMES


def test_both_ends_are_allowed():
    for value in (FRAMES.low, FRAMES.high):
        FRAMES.check("frames", value)
