"""Numbers as text."""

import math

import pytest

from tracking.labels import digits, interval, number, percent, plus_minus, points, signed, span

SAID = [(digits(-1234.56, ",.1f"), "−1,234.6"), (digits(-1e-7, ".2g"), "−1e-07")]
SAID += [(digits(math.nan, ".1f"), "–"), (digits(math.inf, ".1f"), "–")]
SAID += [(number(-26842.123), "−26,842"), (number(0.00123456), "0.0012346")]
SAID += [
    (number(0.0), "0"),
    (number(-7.58303e-22), "0"),
    (number(-0.0), "0"),
    (points(0.04), "+0.0"),
]
SAID += [(signed(-0.004), "+0.00"), (signed(-0.996), "−1.00")]
SAID += [(span(-0.26, 0.31, "z.1f"), "−0.3 to 0.3"), (span(math.nan, math.nan, "z.1f"), "–")]
SAID += [(interval(-0.5, 0.25), "[−0.50, +0.25]"), (interval(0.5, 0.5), "[no interval]")]
SAID += [(plus_minus(71.26, 0.94), "71.3 ± 0.9"), (plus_minus(-0.01, math.nan), "0.0")]


@pytest.mark.parametrize(("text", "expected"), [*SAID, (plus_minus(math.nan, math.nan), "–")])
def test_text_of_a_number(text, expected):
    assert text == expected


def test_probabilities_are_never_certain():
    texts = [percent(p) for p in (0, 0.004, 0.25, 0.99, 0.999, 1)]
    assert texts == ["under 1 %", "under 1 %", "25 %", "99 %", "over 99 %", "over 99 %"]
