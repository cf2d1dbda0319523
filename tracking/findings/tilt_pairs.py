"""Pairs of placements that differ in roll, or in pitch, alone: the paper's ablations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from itertools import combinations

from lidarplace.rigs.placement import Mount

ANGLES = ("roll", "pitch")
_DIGITS = 6  # a micrometre, a microradian


@dataclass(frozen=True)
class TiltPair:
    """Two placements, equal but for one angle of some LiDARs.

    Attributes:
        angle: "roll" or "pitch".
        upright: the name of the placement that is tilted less, summed over LiDARs.
        tilted: the other's.
    """

    angle: str
    upright: str
    tilted: str


def tilt_pairs(placements: Mapping[str, Sequence[Mount]]) -> list[TiltPair]:
    """All pairs of `placements` that differ in one of `ANGLES` alone, in their order.

    The order of the LiDARs does not matter. Pairs in which both are tilted equally much have no
    upright one and are left out.
    """
    found = []
    for angle in ANGLES:
        bases = {name: _without(mounts, angle) for name, mounts in placements.items()}
        tilts = {name: _tilt(mounts, angle) for name, mounts in placements.items()}
        for a, b in combinations(placements, 2):
            if bases[a] == bases[b] and tilts[a] != tilts[b]:
                upright, tilted = sorted((a, b), key=tilts.__getitem__)
                found.append(TiltPair(angle, upright, tilted))
    return found


def _without(mounts: Sequence[Mount], angle: str) -> list[tuple[float, ...]]:
    level = (astuple(replace(mount, **{angle: 0.0})) for mount in mounts)
    return sorted(tuple(round(value, _DIGITS) + 0.0 for value in mount) for mount in level)


def _tilt(mounts: Sequence[Mount], angle: str) -> float:
    return round(sum(abs(float(getattr(mount, angle))) for mount in mounts), _DIGITS)
