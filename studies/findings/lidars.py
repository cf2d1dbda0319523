"""What more LiDARs give, against what another arrangement of as many gives."""

from __future__ import annotations

from rig_results import RigResults, beside_table, led

TARGETS = ("car", "recall")
ARRANGED = {
    "two_front": "two, side by side in front",
    "two_high": "two, rolled outwards at two heights",
    "three_level": "three, level at one height",
    "three_heights": "three, at three heights, two pitched",
    "square": "four, level at one height",
    "center": "four, level at four heights",
    "six_level": "six, level at one height",
    "six_heights": "six, at six heights, pitched",
    "solid_corners": "four solid-state ones of 32 beams, two of them at the front corners",
    "solid_roof": "four solid-state ones of 32 beams on the roof",
}
"""Rigs that were drawn by hand before anything was trained."""


def lidars_table(reference: str) -> str:
    """What the rigs' own detectors reach, with 95 % of the difference to `reference`.

    For all pairs of these rigs at once.
    """
    best = {target: RigResults(list(ARRANGED)).best(target) for target in TARGETS}
    rigs = {name: [f"`{name}`: {words}"] for name, words in ARRANGED.items()}
    return beside_table([""], rigs, best, reference, f"*{reference}*")


def lead(one: str, other: str, target: str) -> str:
    """Own detectors of one of ARRANGED less those of another, 95 % as in the table."""
    return led(RigResults(list(ARRANGED)).best(target).differences(other).loc[one])
