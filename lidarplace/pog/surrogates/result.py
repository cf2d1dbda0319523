"""The surrogates of one placement, and their sum over classes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import pandas as pd

from lidarplace.base.plotting import Plottable
from lidarplace.base.roi import Roi
from lidarplace.coverage import Method
from lidarplace.pog.surrogates.table import POG_SURROGATES, SURROGATES
from lidarplace.rigs.placement import Placement


@dataclass(frozen=True)
class CoveredVoxels:
    """Covered voxels of the whole ROI, also those in which no object ever was.

    They are counted when the number is first read, once for all classes."""

    count: Callable[[], int]

    @cached_property
    def number(self) -> int:
        """Number of covered voxels."""
        return self.count()


class _Named:
    """Types of our own surrogates, which `Surrogates.__getattr__` looks up."""

    s_mig: float
    ig: float
    h_pog: float
    covered_entropy: float
    residual_entropy: float
    m_sog: float
    expected_points: float | None
    expected_ig: float | None
    covered_voxels: int


@dataclass(frozen=True, repr=False)
class Surrogates(_Named, Plottable):
    """Surrogates of one placement for one class, or for the sum of classes; entropies in nats.

    Our own are attributes, such as `s_mig`; `result["s_mig"]` is the same, for those of plug-ins
    too. None for one that needs rays and was not asked for, or that has no sum over classes.

    Attributes:
        placement, roi, method: what was evaluated.
        values: the surrogates that do not follow from others, by name.
        covered: voxels of the whole ROI.
        covered_nonzero: covered voxels with p > 0.
        seconds: wall time of the evaluation."""

    placement: Placement
    roi: Roi
    method: Method
    values: Mapping[str, float]
    covered: CoveredVoxels
    covered_nonzero: int
    seconds: float

    def __getitem__(self, name: str) -> float | None:
        if (of_others := SURROGATES[name].of_others) is None:
            return self.values.get(name)
        rig = f"placement {self.placement.name}"
        return SURROGATES.number(name, partial(of_others, self), rig)

    def asked(self, name: str) -> float:
        """Return the value of a surrogate that was asked for."""
        value = self[name]
        assert value is not None, name
        return value

    if not TYPE_CHECKING:  # a misspelt name is a mistake to mypy

        def __getattr__(self, name: str) -> Any:
            if name not in POG_SURROGATES.own:
                raise AttributeError(f"{type(self).__name__} has no attribute {name!r}")
            return self[name]

    def __repr__(self) -> str:
        numbers = ", ".join(f"{name}={value:.6g}" for name, value in self.values.items())
        return f"Surrogates({self.placement.name!r} by {self.method}: {numbers})"

    def _repr_html_(self) -> str:
        rows = [
            (SURROGATES[name].label, f"{value:,.6g}", SURROGATES[name].unit)
            for name in POG_SURROGATES.among((*SURROGATES.own, *self.values))
            if (value := self[name]) is not None
        ]
        table = pd.DataFrame(rows, columns=["surrogate", self.placement.name, "unit"])
        return table.to_html(index=False)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *POG_SURROGATES.own]


def sum_over_classes(results: Mapping[str, Surrogates]) -> Surrogates:
    """Return the sum of every surrogate over the classes, as the paper compares it with recall.

    "Since the recall is calculated for all Cars, Vans and Cyclists, our total information gain
    surrogate metric is the sum of S-MIG of Car, Van and Cyclist" (appendix). `m_sog` divides the
    sum by the covered voxels, `seconds` are the slowest class's. Raises ValueError without a class,
    or if the classes are not of one placement, ROI and method."""
    if len({(r.placement, r.roi, r.method) for r in results.values()}) != 1:
        raise ValueError("a sum over classes needs results of one placement, ROI and method")
    first, *_ = parts = list(results.values())
    values = {
        name: math.fsum(part.values[name] for part in parts)
        for name in first.values
        if SURROGATES[name].additive and all(name in part.values for part in parts)
    }
    nonzero, seconds = sum(p.covered_nonzero for p in parts), max(p.seconds for p in parts)
    return replace(first, values=values, covered_nonzero=nonzero, seconds=seconds)
