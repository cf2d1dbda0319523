"""What a search writes as `search.json`: what was searched, what was found, how good it can be."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import model_validator

from lidarplace.placement import Mount
from lidarplace.roi import Roi
from tracking.run_folders.json_file import Part, read_result_file

Point = tuple[float, float, float]


class Objective(Part):
    """A value that the search makes large or small.

    Attributes:
        by: the surrogate or metric, in words of the configuration.
        weights: of each class, None where classes do not count.
    """

    name: str
    by: str
    unit: str
    direction: Literal["maximize", "minimize"]
    weights: dict[str, float] | None = None

    @property
    def sign(self) -> int:
        """1 if larger is better, else -1."""
        return 1 if self.direction == "maximize" else -1

    @property
    def label(self) -> str:
        """Name and unit, for an axis."""
        return f"{self.name} ({self.unit})" if self.unit else self.name

    @property
    def better(self) -> str:
        """Which way is better, for an axis."""
        return "more is better" if self.sign > 0 else "less is better"


class Constraint(Part):
    """A measure of a rig that must be at most, or at least, `limit`."""

    name: str
    unit: str
    limit: float
    sense: Literal["at most", "at least"]


class Zone(Part):
    """Where LiDARs may sit: a polygon from above, corners in metres, between two heights."""

    name: str
    polygon: tuple[tuple[float, float], ...]
    z: tuple[float, float]


class Model(Part):
    """A LiDAR model that the search could choose; `price` is None where it is not known."""

    price: float | None
    beams: int
    azimuth_steps: int


class Rig(Part):
    """A placement with what it measures.

    Attributes:
        role: found by the sampler, by greedy, or one of the paper's eight.
        mounts: x, y, z in metres, roll, pitch, yaw in radians.
        models, zones: names, one a mount.
        values: by objective, with all rays; None or absent if it was not evaluated.
        searched: by objective, as the search computes it, see `Stride`.
        measures: by constraint.
        feasible: it keeps every constraint.
    """

    role: Literal["found", "greedy", "paper"]
    mounts: tuple[tuple[float, float, float, float, float, float], ...]
    models: tuple[str, ...]
    zones: tuple[str | None, ...]
    values: dict[str, float | None]
    searched: dict[str, float | None]
    measures: dict[str, float | None]
    feasible: bool

    def value(self, objective: Objective) -> float:
        """With all rays; NaN if it was not evaluated."""
        return _known(self.values.get(objective.name))

    def searched_value(self, objective: Objective) -> float:
        """As the search computes it; NaN if it was not evaluated."""
        return _known(self.searched.get(objective.name))

    @property
    def placed(self) -> tuple[Mount, ...]:
        """The mounts as poses."""
        return tuple(Mount(*mount) for mount in self.mounts)

    @model_validator(mode="after")
    def _as_many(self) -> Rig:
        counts = {len(self.mounts), len(self.models), len(self.zones)}
        if len(counts) > 1 or not self.mounts:
            raise ValueError(
                "needs one model and one zone a mount, found "
                f"{len(self.mounts)} mounts, {len(self.models)} models, {len(self.zones)} zones"
            )
        return self


class Bound(Part):
    """How good the first objective can be over a grid of candidate mounts, as searched.

    Attributes:
        value: no rig of the candidates is better; None if there is no bound, see `reason`.
        by_gains: the bound from marginal gains alone, which `value` may tighten.
        greedy: value of the greedy rig.
        gap_percent: how far `best_value`, of the first of `best`, is below `value`, in percent
            of `value`.
        candidates: number of candidate mounts.
        reason: why there is no bound.
    """

    value: float | None = None
    by_gains: float | None = None
    greedy: float | None = None
    gap_percent: float | None = None
    candidates: int | None = None
    best_value: float | None = None
    reason: str | None = None


class Stride(Part):
    """Every `azimuth_stride`-th azimuth step was fired, with this relative error of the values."""

    azimuth_stride: int
    relative_error: float | None = None


class Spans(Part):
    """Lowest and highest angles of mounts that the search may choose, degrees."""

    roll_deg: tuple[float, float]
    pitch_deg: tuple[float, float]
    yaw_deg: tuple[float, float]


class Command(Part):
    """A line for the shell and what it does."""

    what: str
    line: str


class SearchResult(Part):
    """`search.json`; lengths in metres, angles in radians.

    Attributes:
        command: the line that ran the search.
        seconds, sampler_seconds, evaluation_seconds: of the last command alone.
        trials: asked for; evaluations: rigs that were evaluated; repeated: duplicates that were
            not; feasible: trials that kept every constraint.
        parameters: the largest number of parameters of a trial.
        roi: the region of interest.
        frames: in the POG.
        vehicle: boxes, lowest and highest corner.
        best: names of `rigs`, best first; several are of a Pareto front; empty if none is feasible.
        front: number of rigs of the whole Pareto front; None for one objective.
        baseline: the best of the paper's eight by the first objective, None if they are no peers.
        stride: None where no objective fires rays.
        linear_share: of `expected_ig` of the best rig, see
            `lidarplace.surrogates.evaluate.linear_share`; the largest of the classes that the
            search weighs, None if it is no objective.
        importance: share of each parameter in reaching good values (PED-ANOVA).
    """

    name: str
    command: str
    seconds: float
    objectives: tuple[Objective, ...]
    sampler: str
    seed: int
    batch_size: int
    trials: int
    evaluations: int
    repeated: int
    feasible: int
    sampler_seconds: float
    evaluation_seconds: float
    parameters: int
    constraints: tuple[Constraint, ...]
    classes: tuple[str, ...]
    roi: Roi
    frames: int
    zones: tuple[Zone, ...]
    spans: Spans
    vehicle: tuple[tuple[Point, Point], ...]
    models: dict[str, Model]
    bound: Bound | None
    best: tuple[str, ...]
    front: int | None
    baseline: str | None
    rigs: dict[str, Rig]
    commands: tuple[Command, ...]
    tracking_uri: str | None
    versions: dict[str, str]
    stride: Stride | None
    linear_share: float | None = None
    importance: dict[str, float] | None

    @property
    def first(self) -> Objective:
        """The objective that decides where there is one figure to tell."""
        return self.objectives[0]

    @model_validator(mode="after")
    def _consistent(self) -> SearchResult:
        if not self.objectives:
            raise ValueError("objectives: needs at least one, found none")
        for name in (*self.best, *([self.baseline] if self.baseline else [])):
            if name not in self.rigs:
                raise ValueError(f"rigs: has no {name!r}, which best or baseline names")
            missing = [o.name for o in self.objectives if np.isnan(self.rigs[name].value(o))]
            # The baseline may lack a value: that of LiDARs without a price.
            if missing and name in self.best:
                raise ValueError(f"rigs: {name!r} has no value of {', '.join(missing)}")
        return self


def _known(value: float | None) -> float:
    return float("nan") if value is None else value


def read_search_result(path: Path) -> SearchResult:
    """Read `search.json`.

    Raises:
        ValueError: it is no JSON, or a key is missing or not as it must be.
        OSError: it cannot be read.
    """
    return read_result_file(path, SearchResult)
