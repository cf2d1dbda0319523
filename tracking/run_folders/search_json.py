"""Result file of a search, `search.json`: what was searched, the best rigs, and their bound."""

from __future__ import annotations

from functools import cached_property
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from lidarplace.base.errors import InputError
from lidarplace.base.roi import Roi
from lidarplace.mounting.limits import excess
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.placement import Mount
from tracking.run_folders.json_file import (
    Boxes,
    Part,
    ResultFile,
    Surroundings,
    Triangles,
    drawn_vehicle,
)
from tracking.run_folders.search_tables import trials_of
from tracking.run_folders.sweep_json import Pose
from tracking.run_folders.table_schema import TableSchema

UNNAMED = "lidar"
"""Model of searches without `models`: the LiDAR under the key of this name."""


class Objective(Part):
    """Value that the search makes large or small."""

    name: str
    by: str  # the surrogate or metric, in words of the configuration
    unit: str
    direction: Literal["maximize", "minimize"]
    # of each class, of "all" objects together; None where classes do not count
    weights: dict[str, float] | None = None

    @property
    def sign(self) -> int:
        """Sign of improvement: 1 if larger is better, else -1."""
        return 1 if self.direction == "maximize" else -1

    @property
    def label(self) -> str:
        """Name and unit, for an axis."""
        return f"{self.name} ({self.unit})" if self.unit else self.name

    @property
    def better(self) -> str:
        """Direction of improvement, for an axis."""
        return "more is better" if self.sign > 0 else "less is better"


class Constraint(Part):
    """Measure of a rig that must be at most, or at least, `limit`."""

    name: str
    unit: str
    limit: float
    sense: Literal["at most", "at least"]

    def is_kept(self, measure: float | None) -> bool:
        """Return whether a measure is known and within the limit."""
        at_least = self.sense == "at least"
        return measure is not None and excess(measure, self.limit, at_least=at_least) <= 0


class Angles(Part):
    """Lowest and highest angles of a mount, degrees."""

    roll_deg: tuple[float, float]
    pitch_deg: tuple[float, float]
    yaw_deg: tuple[float, float]


class Zone(Angles):
    """Zone for LiDARs: a polygon from above, corners in metres, between two heights.

    `models`: angles of the models that the zone names. `mirrored`: LiDARs are in mirrored pairs."""

    name: str
    polygon: tuple[tuple[float, float], ...]
    z: tuple[float, float]
    models: dict[str, Angles] = Field(default={})
    mirrored: bool = False


class Model(Part):
    """LiDAR model that the search could choose; `price` is None where it is not known."""

    price: float | None
    beams: int
    azimuth_steps: int


class Rig(Part):
    """Placement with its measures, as JSON that is readable without this project."""

    role: Literal["found", "greedy", "paper", "plain"]
    feasible: bool
    mounts: tuple[Pose, ...]  # x, y, z in metres, roll, pitch, yaw in radians
    models: tuple[str, ...]  # names, one a mount
    zones: tuple[str | None, ...]  # the same
    values: dict[str, float | None]  # by objective, with all rays; None or absent if not evaluated
    searched: dict[str, float | None]  # by objective, as the search computes it, see `Stride`
    measures: dict[str, float | None]  # by constraint

    def value(self, objective: Objective) -> float:
        """Return the value with all rays; NaN if it was not evaluated."""
        return _known(self.values.get(objective.name))

    def searched_value(self, objective: Objective) -> float:
        """Return the value as the search computes it; NaN if it was not evaluated."""
        return _known(self.searched.get(objective.name))

    @property
    def placed(self) -> tuple[Mount, ...]:
        """Mounts as poses."""
        return tuple(Mount(*mount) for mount in self.mounts)

    @model_validator(mode="after")
    def _as_many(self) -> Rig:
        mounts, models, zones = map(len, (self.mounts, self.models, self.zones))
        if not 0 < mounts == models == zones:
            counts = f"{mounts} mounts, {models} models, {zones} zones"
            raise InputError(expected="one model and one zone per mount", found=counts)
        return self


class Bound(Part):
    """Bound of the first objective over a grid of candidate mounts, as searched."""

    value: float | None = None  # no rig of the candidates is better; None if there is no bound
    by_gains: float | None = None  # the bound from marginal gains alone, which `value` may tighten
    greedy: float | None = None  # value of the greedy rig
    candidates: int | None = None  # number of candidate mounts
    best_value: float | None = None  # of the first of `best`
    gap_percent: float | None = None  # how far `best_value` is below `value`
    reason: str | None = None  # why there is no bound


class Stride(Part):
    """Thinning of rays to every `azimuth_stride`-th azimuth step, with the relative error."""

    azimuth_stride: int
    relative_error: float | None = None


class Command(Part):
    """Line for the shell and what it does."""

    what: str
    line: str


class SearchResult(ResultFile):
    """`search.json`; lengths in metres, angles in radians."""

    FILE: ClassVar[str] = "search.json"

    name: str
    """Name of the search."""
    command: str
    """Command that ran the search."""
    commands: tuple[Command, ...]
    """Commands for the found rigs."""
    seconds: float
    """Duration of the last command."""
    objectives: tuple[Objective, ...]
    """Objectives, with direction, unit and the weights of the classes."""
    over: str = ""
    """How values over several tests are combined; empty for one test."""
    chosen_over: str = ""
    """The same for the traffic of the choice."""
    sampler: str
    """Optuna's sampler, by its name in the configuration."""
    seed: int
    """Seed of the sampler."""
    batch_size: int
    """Trials per batch."""
    trials: int
    """Number of trials."""
    evaluations: int
    """Number of evaluated rigs."""
    repeated: int
    """Number of duplicates, which were not evaluated."""
    feasible: int
    """Number of trials that meet every constraint."""
    sampler_seconds: float
    """Duration of the sampler in the last command."""
    evaluation_seconds: float
    """Duration of evaluations in the last command."""
    constraints: tuple[Constraint, ...]
    """Constraints, with limits and units."""
    classes: tuple[str, ...]
    """Object classes, in the order of the configuration."""
    roi: Roi
    """The region of interest."""
    frames: int
    """Number of frames in the POG."""
    zones: tuple[Zone, ...]
    """Zones for LiDARs."""
    vehicle: Boxes
    """Boxes, lowest and highest corner."""
    vehicle_mesh: Triangles | None = None
    """Its mesh, if it has one, in so few triangles that it can be drawn."""
    site: Surroundings | None = None
    """Buildings and lanes around a site, whose `vehicle` are keep-outs; null: a vehicle."""
    models: dict[str, Model]
    """LiDAR models of the search, by name."""
    bound: Bound | None
    """Upper bound of the first objective, or why there is none."""
    best: tuple[str, ...]
    """Names of `rigs`, best first; several for a Pareto front; empty if none is feasible."""
    front: int | None
    """Number of rigs of the whole Pareto front; null for one objective."""
    parameters: int
    """The largest number of parameters of a trial."""
    baseline: str | None
    """Best of the plain rigs, or of the paper's eight, by the first objective; null without any."""
    rigs: dict[str, Rig]
    """Placements by name, with their results."""
    importance: dict[str, float] | None
    """Share of each parameter in reaching good values (PED-ANOVA)."""
    stride: Stride | None
    """How rays were thinned, and its error; null if no objective uses rays."""
    cautions: tuple[str, ...] = ()
    """Warnings about the best rig and the first trials."""
    linear_share: float | None = None
    """Of `expected_ig` of the best rig, see `lidarplace.pog.surrogates.evaluate.linear_share`; the
    largest of the classes that the search weighs, null if it is no objective."""
    tracking_uri: str | None
    """MLflow's tracking URI, without passwords."""
    versions: dict[str, str]
    """Versions of Python and of the libraries."""

    @cached_property
    def body(self) -> Vehicle:
        """Vehicle, or poles, that pictures show."""
        return drawn_vehicle(self.vehicle, self.vehicle_mesh, self.site)

    @property
    def first(self) -> Objective:
        """Objective that decides where one figure is reported."""
        return self.objectives[0]

    @property
    def strided(self) -> str:
        """Description of the rays that the search fired; "" if it fired all, or none at all."""
        if self.stride is None or self.stride.azimuth_stride <= 1:
            return ""
        return f"rays of 1 in {self.stride.azimuth_stride} azimuth steps"

    @property
    def trials_table(self) -> TableSchema:
        """Contract of the table of trials."""
        return trials_of((o.name for o in self.objectives), (c.name for c in self.constraints))

    @model_validator(mode="after")
    def _consistent(self) -> SearchResult:
        if not self.objectives:
            raise InputError(key="objectives", expected="at least one", found="none")
        for name in filter(None, (*self.best, self.baseline)):
            if name not in self.rigs:
                raise InputError("missing, but named in best or baseline", key=f"rigs.{name}")
            missing = [o.name for o in self.objectives if np.isnan(self.rigs[name].value(o))]
            # The baseline may lack a value: that of LiDARs without a price.
            if missing and name in self.best:
                raise InputError(f"missing {', '.join(missing)}", key=f"rigs.{name}.values")
        return self


def _known(value: float | None) -> float:
    return float("nan") if value is None else value
