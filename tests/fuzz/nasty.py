"""Values that no reader expects."""

import math
from random import Random
from typing import Any

NUMBERS: tuple[float, ...] = (
    *(math.nan, math.inf, -math.inf, -1, -0.5, 0, 1e30, -1e30, 1e308, 5e-324),
    *(2**31, 2**53 + 1, 2**63 - 1, -(2**63), 2**63, 2**64, 10**40, 99999999999999),
)
TEXTS = (
    *("", " ", "banana", "nan", "-", "None", "0x10", "1e999", "1_000", "\x00", "a\x00b", "../.."),
    *("car", "[/x]", "[red]", "\x1b[31m", "=1+1", "é" * 3, "\u202e", "x" * 5000, "\n", "\r\n"),
)


def number(random: Random) -> float:
    """One of `NUMBERS`."""
    return random.choice(NUMBERS)


def value(random: Random) -> Any:
    """Plain data of any type."""
    return random.choice(
        (
            lambda: number(random),
            lambda: random.choice(TEXTS),
            lambda: random.choice((None, True, False)),
            lambda: random.choice(([], {}, [[]], [1, 2], {"a": 1}, [None], [[1, 2], [3]])),
        )
    )()
