"""Probability that a detector finds an object, by the cells of its surface that are hit.

`p = most * (1 - exp(-rate * cells))`: every cell gives the detector a chance of its own, as every
ray does in `expected_ig`, and a share `1 - most` of the objects is lost whatever is seen of them.
It rises and is concave, so a mean of it over objects is monotone and submodular in the LiDARs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from lidarplace.base.errors import InputError
from lidarplace.configuration.settings import fault
from lidarplace.files.atomic import read_text, write_text

CELL_M = 0.2
"""Edge of a cell where a curve is fitted, metres."""
IOU = 0.5
"""Overlap of which `expected_recall` is, unless another is given."""
_FARTHEST = 12.0
"""Logit and logarithm between which `fit` looks: shares and rates from 6e-6 on."""


class DetectionCurve(BaseModel):
    """The curve of one class at one overlap."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    object_class: str = Field(alias="class", description="class of the objects")
    iou: float = Field(gt=0, lt=1, description="3D IoU that a detection must exceed")
    most: float = Field(gt=0, le=1, description="probability for an object that is seen completely")
    rate: float = Field(gt=0, description="chance that a further cell adds, in nats")

    def probability(self, cells: ArrayLike) -> NDArray[np.float64]:
        """Return the probability of detection by distinct cells hit, any shape."""
        return self.most * -np.expm1(-self.rate * np.asarray(cells, np.float64))

    def cells(self, probability: float) -> float:
        """Return the number of cells that gives a probability; infinite above all of them."""
        left = 1.0 - probability / self.most
        return math.inf if left < 0 else -math.log(max(left, 2.0**-53)) / self.rate


class DetectionCurves(BaseModel):
    """The curves of a file."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    command: str = Field(description="what made the file")
    cell: float = Field(gt=0, description="edge of a cell, metres")
    curves: tuple[DetectionCurve, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _each_once(self) -> Self:
        keys = [(curve.object_class, curve.iou) for curve in self.curves]
        twice = {key for key in keys if keys.count(key) > 1}
        if twice:
            raise InputError("duplicate curve", key="curves", found=sorted(twice)[0])
        return self

    def has(self, object_class: str, iou: float) -> bool:
        """Return whether there is a curve of a class at an overlap."""
        return any((curve.object_class, curve.iou) == (object_class, iou) for curve in self.curves)

    def lent(self, of: str, to: str, iou: float) -> Self:
        """Return curves with that of a class for another class, too; ValueError as `of`."""
        curve = self.of(of, iou).model_copy(update={"object_class": to})
        return self.model_copy(update={"curves": (*self.curves, curve)})

    def of(self, object_class: str, iou: float) -> DetectionCurve:
        """Return the curve of a class at an overlap. Raises ValueError if there is none."""
        for curve in self.curves:
            if curve.object_class == object_class and curve.iou == iou:
                return curve
        available = ", ".join(f"{curve.object_class} at {curve.iou:g}" for curve in self.curves)
        curve_name, fix = f"{object_class} at {iou:g}", "lidarplace calibrate makes others"
        raise InputError("no detection curve", expected=available, found=curve_name, fix=fix)


def fit(object_class: str, iou: float, cells: ArrayLike, found: ArrayLike) -> DetectionCurve:
    """Fit the most probable curve to which objects of a class were found at an overlap.

    `cells` are distinct cells hit of each object under each rig, shape (n,), n > 0; `found` whether
    it was found, or the share of several detectors that did, in [0, 1], shape (n,). Shares count as
    so many yes and no. Where nothing was found, or all, `most` is within 1e-5 of 0 or 1."""
    from scipy.optimize import minimize

    seen, share = np.asarray(cells, np.float64), np.asarray(found, np.float64)
    if not len(seen):
        raise ValueError(f"no {object_class} was observed, so it has no detection curve")

    def cost(logs: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        """Return negative mean log likelihood and gradient, by logit and log of the curve."""
        most, rate = 1 / (1 + np.exp(-logs[0])), np.exp(logs[1])
        missed = np.exp(-rate * seen)
        p = np.clip(most * (1 - missed), 1e-9, 1 - 1e-9)
        slope = (1 - share) / (1 - p) - share / p
        by_most = (slope * (1 - missed)).mean() * most * (1 - most)
        by_rate = (slope * most * missed * seen).mean() * rate
        value = -(share * np.log(p) + (1 - share) * np.log1p(-p)).mean()
        return float(value), np.array([by_most, by_rate])

    bounds = [(-_FARTHEST, _FARTHEST)] * 2
    starts = [np.array([0.0, start]) for start in (-5.0, -3.0, -1.0)]
    tries = [minimize(cost, x0, jac=True, method="L-BFGS-B", bounds=bounds) for x0 in starts]
    logit, log_rate = min(tries, key=lambda one: one.fun).x
    most, rate = f"{1 / (1 + np.exp(-logit)):.4g}", f"{np.exp(log_rate):.4g}"
    curve = {"class": object_class, "iou": iou, "most": float(most), "rate": float(rate)}
    return DetectionCurve.model_validate(curve)


def read_curves(path: Path) -> DetectionCurves:
    """Read a file of curves.

    Raises OSError, or ValueError that names the file, the key and what is wrong."""
    try:
        return DetectionCurves.model_validate_json(read_text(path))
    except ValidationError as error:
        raise fault(error, str(path)) from None


def write_curves(path: Path, command: str, curves: Sequence[DetectionCurve]) -> None:
    """Write a file of curves with cells of `CELL_M`; renamed into place."""
    text = DetectionCurves(command=command, cell=CELL_M, curves=tuple(curves))
    write_text(path, text.model_dump_json(by_alias=True, indent=2) + "\n")


def default_curves() -> DetectionCurves:
    """Return the curves that come with the package; their `command` says where from."""
    return _packaged_curves()


@cache
def _packaged_curves() -> DetectionCurves:
    text = files(__package__).joinpath("default_curves.json").read_text(encoding="utf-8")
    return DetectionCurves.model_validate_json(text)
