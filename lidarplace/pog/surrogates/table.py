"""The table of the surrogates: all that there is to know of each, in the order of display.

Configuration, evaluation, error tables, search, statistics and report read it; other packages add
theirs (docs/extending.md). Most start from the POG of a class; those of `OBJECT_SURROGATES` from
the objects of the log, see `lidarplace.recall`."""

import math
from collections.abc import Callable, Iterable
from typing import Annotated, Any, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from lidarplace.base.errors import InputError
from lidarplace.base.metrics import STRICT, Direction
from lidarplace.base.registry import Registry
from lidarplace.pog.surrogates.inputs import SurrogateInputs


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Surrogate:
    """A number for a placement and a class. Raises ValueError for a wrong field.

    Attributes:
        label: how it is called in figures and tables.
        short: the same where there is little room; `label` if "".
        unit: of its values.
        meaning: its definition in a line.
        of_seen: computes it from what a placement sees; None if it follows from others.
        of_others: computes it from the others of a `Surrogates`, when it is read.
        of_objects: whether it is a mean over the objects of the log, by what rays hit of them, and
            not of the POG.
        sense: 1 if more sensing raises it, -1 if more sensing lowers it, 0 if neither.
        contested: whether the paper maximises it, though more sensing lowers it: then nothing is
            taken for granted, a user says what is best.
        fixed: whether it is the same for every placement.
        additive: whether its sum over classes means something.
        power: of the resolution, by which values of different resolutions become comparable.
        needs_rays: whether it needs the rays through every voxel; computed when asked for.
        occludes: whether it weakens rays on their way where a user wants that, so that their
            number is useless.
        beside: another surrogate that it is listed with; it cannot be asked for by itself.
        headline: its place among those that headlines name; None if it orders placements as one
            of these does, or the other way round.
        decides: its place among those that order placements where nothing was trained, of which
            the first that was computed does; all of these can only rise by a LiDAR more."""

    label: Annotated[str, Field(min_length=1)]
    short: str = ""
    unit: str
    meaning: str
    of_seen: Callable[[SurrogateInputs], float] | None = None
    of_others: Callable[[Any], float] | None = None
    of_objects: bool = False
    sense: Literal[-1, 0, 1]
    contested: bool = False
    fixed: bool = False
    additive: bool = True
    power: int = 0
    needs_rays: bool = False
    occludes: bool = False
    beside: str | None = None
    headline: int | None = None
    decides: int | None = None

    def __post_init__(self) -> None:
        ways = (self.of_seen, self.of_others, self.of_objects or None)
        if sum(way is not None for way in ways) != 1:
            raise InputError(key="of_seen, of_others", expected="one of them", found="both or none")

    @property
    def direction(self) -> Direction:
        """Direction of the best values unless a user says else; the paper's if contested."""
        return "minimize" if self.sense < 0 and not self.contested else "maximize"


_OWN = {
    "s_mig": Surrogate(
        label="S-MIG",
        unit="nats",
        meaning="`-sum over covered v of H(v)`, to the letter of the paper (section 3.3)",
        of_seen=lambda seen: 0 - seen.entropy_of(seen.covered),  # 0 - x: no negative zero
        sense=-1,
        contested=True,
        power=2,
        headline=1,
    ),
    "ig": Surrogate(
        label="IG",
        unit="nats",
        # Little is left of the difference where nearly all is covered.
        meaning="`h_pog + s_mig`, the paper's, summed over the voxels that are not covered",
        of_seen=lambda seen: seen.entropy_of(seen.voxels - seen.covered),
        sense=-1,
        contested=True,
        power=3,
    ),
    "h_pog": Surrogate(
        label="H_POG",
        unit="nats",
        meaning="`sum over v of H(v)`, the entropy of the POG",
        of_seen=lambda seen: seen.h_pog,
        sense=0,
        fixed=True,
        power=3,
    ),
    "covered_entropy": Surrogate(
        label="covered entropy",
        unit="nats",
        meaning="`sum over covered v of H(v)`, the opposite of S-MIG",
        of_others=lambda others: 0 - others.s_mig,
        sense=1,
        power=2,
        decides=2,
    ),
    "residual_entropy": Surrogate(
        label="residual entropy",
        unit="nats",
        meaning="`h_pog - covered_entropy`, what stays unseen: the information gain",
        of_others=lambda others: others.ig,
        sense=-1,
        power=3,
    ),
    "m_sog": Surrogate(
        label="M-SOG",
        unit="nats per voxel",
        meaning="`s_mig / covered_voxels` (Place3D, NeurIPS 2024); NaN if nothing is covered",
        of_others=lambda others: (
            others.s_mig / others.covered_voxels if others.covered_voxels else math.nan
        ),
        sense=0,
        additive=False,
        headline=3,
    ),
    "expected_points": Surrogate(
        label="expected points",
        unit="points",
        meaning="`sum of m(v) p(v)`, m(v) rays through v",
        of_seen=lambda seen: seen.points(),
        sense=1,
        power=1,
        needs_rays=True,
        headline=4,
        decides=4,
    ),
    "expected_ig": Surrogate(
        label="expected IG",
        short="E-IG",
        unit="nats",
        meaning="mutual information with a sensor that can miss",
        of_seen=lambda seen: seen.information(),
        sense=1,
        power=2,
        needs_rays=True,
        occludes=True,
        headline=2,
        decides=3,
    ),
    "covered_voxels": Surrogate(
        label="covered voxels",
        unit="voxels",
        meaning="covered voxels of the whole ROI, those included in which no object ever was",
        of_others=lambda others: others.covered.number,
        sense=1,
        additive=False,
        beside="m_sog",
        headline=5,
    ),
    "expected_recall": Surrogate(
        label="expected recall",
        short="E-recall",
        unit="of the objects",
        meaning="mean probability that an object is found, by a curve of the distinct cells hit",
        of_objects=True,
        sense=1,
        headline=6,
        decides=1,
    ),
    "log_cells": Surrogate(
        label="mean ln(1 + cells)",
        short="ln cells",
        unit="nats",
        meaning="mean of ln(1 + distinct cells of an object's surface that are hit)",
        of_objects=True,
        sense=1,
    ),
    "log_points": Surrogate(
        label="mean ln(1 + points)",
        short="ln points",
        unit="nats",
        meaning="mean of ln(1 + points on an object)",
        of_objects=True,
        sense=1,
    ),
    "enough_points": Surrogate(
        label="objects with 5 points",
        short="5 points",
        unit="of the objects",
        meaning="share of objects with 5 points or more",
        of_objects=True,
        sense=1,
    ),
}
SURROGATES = Registry(
    "lidarplace.surrogates",
    _OWN,
    fits=lambda found: isinstance(found, Surrogate) and not found.of_objects,
)
"""Surrogates by name, ours in the order of display."""
ASKED_FOR = SURROGATES.where(lambda own: own.beside is None)
"""Surrogates that a user can ask for."""
OBJECT_SURROGATES = SURROGATES.where(lambda own: own.of_objects)
"""Means over the objects of the log."""
POG_SURROGATES = SURROGATES.where(lambda own: not own.of_objects)
"""Surrogates of a POG, in the order of display."""
ASKED_OF_POG = SURROGATES.where(lambda own: own.beside is None and not own.of_objects)
"""Surrogates of a POG that a user can ask for."""
RAY_SURROGATES = SURROGATES.where(lambda own: own.needs_rays)
"""Surrogates that need the number of rays through every voxel; computed when asked for."""


def to_ask_for(names: Iterable[str]) -> list[str]:
    """Return the `names` that `evaluate` computes only if asked: those of rays, and of plug-ins."""
    return [name for name in names if name in RAY_SURROGATES or name not in SURROGATES.own]


HEADLINE_SURROGATES = SURROGATES.where(lambda own: own.headline)
"""Surrogates with an order of their own: others order placements as S-MIG or its negative."""
DECIDING = SURROGATES.where(lambda own: own.decides)
"""Surrogates that order placements where nothing was trained: the first that was computed."""
