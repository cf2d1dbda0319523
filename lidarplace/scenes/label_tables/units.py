"""Units of label files, as factors to metres, radians and seconds, and what they may be."""

import math
import re
import unicodedata
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarplace.logs.plausibility import STEP_S

LengthUnit = Literal["m", "cm", "mm"]
AngleUnit = Literal["rad", "deg"]
TimeUnit = Literal["s", "ms", "us", "ns", "iso"]
METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
RADIANS = {"rad": 1.0, "deg": math.pi / 180}
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "iso": 1e-6}
"""Dates of ISO 8601 become microseconds since 1970."""
DISTANCES = (300.0, 6000.0)
"""Median distance of a box from the vehicle from which it is in centimetres, and in millimetres."""
EPOCH = {"s": 1e9, "ms": 1e12, "us": 1e15, "ns": 1e18}
"""Time since 1970 by unit: at least this from 2001 on."""


class Guess(NamedTuple):
    """A unit, and the evidence for it."""

    unit: str
    why: str


def guess_angle(name: str, values: NDArray[np.float64]) -> Guess:
    """Guess the unit of a yaw."""
    if (unit := unit_in(name)) in RADIANS:
        return Guess(unit, "by its name")
    largest = np.nanmax(np.abs(values), initial=0.0)
    turned = values[np.isfinite(values) & (values != 0)]
    if largest > 2 * math.pi + 0.01:
        return Guess("deg", f"up to {largest:.5g}: more than a turn of radians")
    if len(turned) and (turned % 1 == 0).all():
        return Guess("deg", "whole numbers")
    return Guess("rad", f"up to {largest:.5g}")


def guess_length(name: str, median: float, limits: tuple[float, float], quantity: str) -> Guess:
    """Guess the unit of lengths by their median; from `limits` on they are cm, and mm."""
    if (unit := unit_in(name)) in METRES:
        return Guess(unit, "by its name")
    unit = "m" if not median >= limits[0] else "cm" if median < limits[1] else "mm"
    return Guess(unit, f"{quantity} is {median:.5g} in the median")


def guess_time(name: str, largest: float, step: float) -> Guess:
    """Guess the unit of time stamps up to `largest`, `step` apart in the median."""
    if (unit := unit_in(name)) in SECONDS:
        return Guess(unit, "by its name")
    for epoch, size in EPOCH.items():
        if size <= largest < 10 * size:
            return Guess(epoch, f"{largest:.4g} is a time since 1970")
    for short, seconds in SECONDS.items():
        if STEP_S[0] <= step * seconds <= STEP_S[1]:
            return Guess(short, f"{step:.4g} from one to the next in the median")
    return Guess("s", "no evidence")


def plain(name: str) -> str:
    """Write a name in lower case with underscores: `posX [mm]` is `pos_x_mm`, `Höhe` is `hohe`."""
    bare = "".join(c for c in unicodedata.normalize("NFKD", name) if not unicodedata.combining(c))
    apart = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", bare)
    return re.sub(r"[^a-z0-9]+", "_", apart.lower()).strip("_")


def unit_in(name: str) -> str:
    """Return the unit at the end of a name, `mm` of `length_mm`; empty if there is none."""
    rest, _, last = plain(name).rpartition("_")
    unit = "deg" if last == "degrees" else last
    return unit if rest and unit in METRES | RADIANS | SECONDS else ""


def without_unit(name: str) -> str:
    """Return the plain name without its unit."""
    return plain(name).rpartition("_")[0] if unit_in(name) else plain(name)
