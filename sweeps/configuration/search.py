"""The configuration of a search: its space, objectives, constraints and sampler."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationInfo, field_validator, model_validator

from lidarplace.base.errors import InputError
from lidarplace.base.metrics import METRICS
from lidarplace.configuration.further_sensors import CameraSettings, RadarSettings, further_sensors
from lidarplace.configuration.mounting import (
    REAL_MOUNTS,
    KeepOuts,
    LimitSettings,
    MountingErrorSettings,
    mountable,
)
from lidarplace.configuration.settings import (
    Count,
    CountFromOne,
    Degrees,
    Distance,
    Name,
    Seconds,
    Seed,
    Settings,
    short_for,
)
from lidarplace.configuration.vehicle import OwnVehicle, vehicle_of
from lidarplace.configuration.zones import CountRange, Turn, ZoneSettings
from lidarplace.requirements.settings import Requirements
from lidarplace.rigs.further_sensors import MountedSensor
from lidarplace.rigs.placement import Mount
from lidarplace.scenes.kerbs import with_strips
from sweeps.configuration.mountable_lidars import FixedSettings, ModelSettings
from sweeps.configuration.objective import (
    DEFAULT_METRIC,
    GENERALIST,
    PRETRAINED,
    TOTALS,
    ObjectiveSettings,
    as_objective,
)
from sweeps.configuration.point import Point
from sweeps.configuration.sweep import Common

SAMPLERS = ("tpe", "gp", "cmaes", "nsga2", "nsga3", "random", "qmc")
FAMILIES = 16
"""Trials of families with which a search by a generalist begins."""


def _several(value: Any) -> Any:
    return value if isinstance(value, (list, tuple)) else [value]


class GreedySettings(Settings):
    """A grid of candidate mounts, from which greedy choice selects the best, one by one."""

    position_step: Annotated[Distance, Field(ge=1e-6)] = Field(
        0.25, description="metres between candidates"
    )
    angle_step_deg: Annotated[Degrees, Field(ge=1e-6)] = Field(
        10.0, description="degrees between candidates"
    )
    most: CountFromOne = Field(4000, description="maximum number of candidates")
    refine: Count = Field(
        3, description="how often the steps are halved around greedy's LiDARs, one by one"
    )
    bound_seconds: Seconds = Field(30.0, description="time for the upper bound")
    warm_start: bool = Field(True, description="the first trial is greedy's placement")


class CheapestSettings(Settings):
    """Settings of `lidarplace cheapest`; a search ignores them."""

    by: Literal["lidars", "price", "power", "height"] = Field(
        "lidars",
        description="what to minimise: the number of LiDARs, their price with mounts, their "
        "power, or the height of the highest mount; then the number of LiDARs",
    )
    recall: Annotated[float, Field(gt=0, le=100, allow_inf_nan=False)] | None = Field(
        None,
        description="smallest percent of the objective, such as pretrained.recall, on the traffic "
        "of the choice; null: any",
    )
    seconds: Seconds = Field(60.0, gt=0, description="time for the choice from the grid")


Tests = Annotated[tuple[dict[str, Any], ...], BeforeValidator(_several), Field(min_length=1)]
"""Changes to the configuration, one or several."""


class TrafficSettings(Settings):
    """Test traffic for a search by a generalist; verify uses that of the scene itself.

    The training traffic of the generalist stays as the scene has it. Choice and evaluation of a rig
    use different traffic: the best of hundreds is also the luckiest."""

    search: Tests = Field(
        default=({},),
        description="key path -> value: the test traffic of the trials, or a list of several; "
        "simulated traffic has scene.test_seed: seed + 1001 (1003, 1005, …) in "
        "addition",
    )
    choice: Tests = Field(
        default=({},),
        description="test traffic on which the best trials are evaluated again; with "
        "scene.test_seed: seed + 1002 (1004, …)",
    )


class SearchSettings(Settings):
    """Space of a search, its objectives, constraints and sampler."""

    lidars: CountRange | None = Field(
        None,
        description="number of LiDARs in all zones, or [min, max], in addition to `fixed` ones; "
        "null: what the zones say, or 4",
    )
    zones: dict[Name, ZoneSettings] = Field(min_length=1, description="by name")
    models: dict[Name, Annotated[ModelSettings, short_for("name")]] = Field(
        default={}, description="LiDAR models by name; by default the one of the key `lidar`"
    )
    roll_deg: Turn = Field((0.0, 0.0), description="a number or [min, max], degrees")
    pitch_deg: Turn = Field((0.0, 0.0), description="a number or [min, max], degrees")
    yaw_deg: Turn = Field((0.0, 0.0), description="a number or [min, max], degrees")
    symmetric: bool = Field(
        False, description="mirrored pairs, and one on the centre line if the number is odd"
    )
    fixed: tuple[FixedSettings, ...] = Field((), description="LiDARs with a fixed mount")
    cameras: tuple[CameraSettings, ...] = Field(
        (),
        description="cameras of every rig; they count in requirements, common view, price and "
        "power",
    )
    radars: tuple[RadarSettings, ...] = Field((), description="the same")
    start: tuple[Name, ...] = Field(
        (), description="first trials: the paper's or own placements, such as your current rig"
    )
    adapt: CountFromOne | None = Field(
        None,
        description="trials of a first round, NAME_first, with the weights of objective: "
        "pretrained. They are then trained further on rigs near the best, with the settings of "
        "`generalist`, and evaluate the other trials, which start from these rigs",
    )
    near_start: bool = Field(
        False,
        description="a generalist is trained on rigs near those of `start`, off by up to a tenth "
        "of a zone and 5 degrees, instead of rigs anywhere in the zones",
    )
    families: Count | None = Field(
        None,
        description="first trials, from families with few parameters: LiDARs around the middle of "
        "a zone, across, in a stack, with pitches that interleave rings or a roll outwards; null: "
        "16 where a generalist evaluates, else none",
    )
    vehicle: OwnVehicle = Field(None, description="the body of the vehicle; a car by default")
    keep_out: KeepOuts = Field(default={})
    constraints: LimitSettings = Field(LimitSettings(), description="limits of a placement")
    requirements: Requirements = Field(
        (),
        description="what must be seen around the vehicle, as in a file of requirements; other "
        "rigs are infeasible",
    )
    objective: Annotated[
        tuple[Annotated[ObjectiveSettings, BeforeValidator(as_objective)], ...],
        BeforeValidator(_several),
    ] = Field(
        (ObjectiveSettings(by=DEFAULT_METRIC, evaluator=GENERALIST),),
        min_length=1,
        description="one or several; expected_ig.Car is short for one class; generalist by default",
    )
    sampler: Literal[SAMPLERS] = Field(  # type: ignore[valid-type]
        "tpe", description="Optuna sampler"
    )
    trials: CountFromOne = Field(
        400, description="number of rigs to evaluate; a larger number continues a search"
    )
    batch_size: CountFromOne = Field(8, description="trials per batch; the result depends on it")
    seed: Seed = Field(0, description="of the sampler")
    azimuth_stride: CountFromOne = Field(
        8, description="expected_points and expected_ig use every n-th azimuth step"
    )
    seeds: tuple[Seed, ...] = Field(
        (0,), min_length=1, description="generalists, whose mean counts"
    )
    traffic: TrafficSettings = Field(
        TrafficSettings(), description="traffic on which a generalist evaluates rigs"
    )
    vehicles: CountFromOne | None = Field(
        None,
        description="number of vehicles of a rig that a generalist evaluates, each with its own "
        "mounting errors in all frames; null: every frame has another vehicle",
    )
    over: Literal["mean", "worst"] = Field(
        "mean", description="how values over traffic and vehicles are combined"
    )
    greedy: GreedySettings | None = Field(
        GreedySettings(), description="greedy choice and upper bound; null: none"
    )
    cheapest: CheapestSettings = Field(
        CheapestSettings(), description="settings of `lidarplace cheapest`, which uses this grid"
    )

    def said_of(self, tests: Tests) -> str:
        """Describe the traffic over which values are combined; "" for a single kind."""
        traffic = [f"{len(tests)} kinds of traffic"] if len(tests) > 1 else []
        vehicles = [f"{self.vehicles} vehicles of a rig"] if self.vehicles is not None else []
        kinds = " with ".join(traffic + vehicles)
        return f"the {self.over} over {kinds}" if kinds else ""

    @model_validator(mode="after")
    def _fits(self) -> SearchSettings:
        if self.lidars is not None and self.lidars[0] < 1:
            expected = "a number, or [min, max] with 1 <= min <= max"
            raise InputError(key="lidars", expected=expected, found=list(self.lidars))
        names = [objective.name for objective in self.objective]
        if len(set(names)) < len(names):
            raise InputError("duplicates", key="objective", found=", ".join(names))
        measured = [objective for objective in self.objective if objective.measured]
        if measured and any(o.of_traffic for o in self.objective):
            raise InputError("measured values and surrogates cannot be combined", key="objective")
        for name in (o.name for o in measured if not o.uses_generalist):
            expected = f"generalist.{name} or pretrained.{name}"
            raise InputError(key="objective", expected=expected, found=name)
        if measured:
            tests = max(len(self.traffic.search), len(self.traffic.choice))
            if self.over == "worst" and tests * (self.vehicles or 1) == 1:
                raise InputError("worst needs several kinds of traffic, or vehicles", key="over")
        else:
            for key in ("traffic", "vehicles", "over"):
                if getattr(self, key) != type(self).model_fields[key].default:
                    raise InputError("applies only to objectives of a generalist", key=key)
        if self.adapt is not None:
            if not all(o.evaluator == PRETRAINED or not o.measured for o in self.objective):
                raise InputError("is for an objective that begins with pretrained", key="adapt")
            if not measured or self.adapt >= self.trials:
                raise InputError(key="adapt", expected="fewer than `trials`", found=self.adapt)
        if self.near_start and not self.start:
            raise InputError("name the rigs in `start`", key="near_start")
        self._check_zones()
        self.further()
        for fixed in self.fixed:
            if fixed.lidar is not None:
                raise InputError("lidar: define it in `models`, and set `model` here", key="fixed")
            if fixed.model is not None and fixed.model not in self.models:
                models = f"one of {', '.join(self.models) or 'models'}"
                raise InputError(f"unknown model {fixed.model!r}", key="fixed", expected=models)
        self._check_sampler()
        return self

    @property
    def first_families(self) -> int:
        """Number of first trials from families."""
        default = FAMILIES if self.objective[0].uses_generalist else 0
        return default if self.families is None else self.families

    @property
    def further_settings(self) -> tuple[CameraSettings | RadarSettings, ...]:
        """Settings of cameras and radars."""
        return (*self.cameras, *self.radars)

    def further(self) -> tuple[MountedSensor, ...]:
        """Return cameras and radars. Raises ValueError as `further_sensors` does."""
        mounts = [Mount(*settings.pose) for settings in self.further_settings]
        return further_sensors(self.cameras, self.radars, mounts)

    @property
    def by_zone(self) -> bool:
        """Whether LiDARs are counted by zone, as they differ in number, models or angles."""
        return any(zone.has_kinds for zone in self.zones.values())

    @property
    def total(self) -> tuple[int, int]:
        """Least and greatest number of LiDARs in all zones, without fixed ones."""
        counts = [(zone.lidars, zone.size) for zone in self.zones.values() if zone.lidars]
        if self.lidars is not None or not counts:
            return self.lidars or (4, 4)
        low, high = (sum(count[end] * size for count, size in counts) for end in (0, 1))
        return low, high

    @property
    def zone_counts(self) -> dict[str, tuple[int, int]]:
        """Least and greatest number of LiDARs by zone; a mirrored pair counts once."""
        _, most = self.total
        return {n: zone.lidars or (0, -(-most // zone.size)) for n, zone in self.zones.items()}

    def _check_zones(self) -> None:
        """Check zones: their models, and whether there is a number of LiDARs."""
        without = [name for name, zone in self.zones.items() if zone.lidars is None]
        if self.lidars is None and 0 < len(without) < len(self.zones):
            fix = "set it, or search.lidars"
            raise InputError(
                "missing; other zones have it", key=f"zones.{without[0]}.lidars", fix=fix
            )
        if self.by_zone and self.symmetric:
            problem = "the zones differ in numbers, models or angles"
            raise InputError(problem, key="symmetric", fix="set `mirrored` in the zones instead")
        if not any(high for _, high in self.zone_counts.values()):
            raise InputError("no zone allows a LiDAR", key="zones")
        mountable(self.zones, vehicle_of(self.vehicle))
        models = ", ".join(self.models) or "one of search.models, which has none"
        for name, zone in self.zones.items():
            for model in zone.models or ():
                if model not in self.models:
                    key = f"zones.{name}.models"
                    raise InputError(f"no model {model!r}", key=key, expected=models)
        common = {"constraints": self.constraints.common_view}
        common |= {
            f"requirements {sensor.name!r}": sensor.common_view for sensor in self.requirements
        }
        for where, view in common.items():
            if view is not None and not isinstance(view.pairs, str):
                problem = "LiDARs of a search have no fixed numbers"
                pairs = [list(pair) for pair in view.pairs]
                key = f"{where}.common_view.pairs"
                raise InputError(problem, key=key, expected="all or chain", found=pairs)
        objectives = {objective.by for objective in self.objective}
        for total in TOTALS:
            if getattr(self.constraints, total) is not None or total in objectives:
                self._check_total(total)
        if "margin" in objectives and not self.requirements:
            raise InputError("margin needs search.requirements", key="objective")

    def _check_total(self, total: str) -> None:
        """Check that price or power of all sensors is known. Raises InputError."""
        for name, model in self.models.items():
            if math.isnan(model.total(total)):
                problem = "missing" if total == "price" else "not in the catalogue"
                raise InputError(problem, key=f"models.{name}.{total}", fix="set it")
        if total == "power" and not self.models:
            problem = "define the LiDARs there, so that their power is known"
            raise InputError(problem, key="models")
        for sensor in self.further_settings:
            if getattr(sensor, total) is None:
                key = "cameras" if sensor in self.cameras else "radars"
                raise InputError(f"{sensor.name or key}: missing {total}", key=key, fix="set it")

    def _check_sampler(self) -> None:
        if self.sampler != "cmaes":
            return
        if len(self.objective) > 1:
            problem, fix = "cmaes supports one objective", "use nsga2, nsga3, tpe or gp"
            raise InputError(problem, key="sampler", fix=fix)
        constraints = self.constraints.model_dump().items()
        limits = [k for k, v in constraints if v is not None and (k, v) != ("distance", 0)]
        # A generalist does not evaluate what breaks a constraint, and CMA-ES draws another.
        if limits and not self.objective[0].uses_generalist:
            problem = f"cmaes ignores constraints ({', '.join(limits)})"
            fix = "use tpe, gp, nsga2 or nsga3, or remove them (constraints.distance: 0)"
            raise InputError(problem, key="sampler", fix=fix)


class RobustnessSettings(Settings):
    """Conditions under which the winner is assessed again."""

    draws: CountFromOne = Field(32, description="number of rigs with mounting errors")
    offset: Distance = Field(
        REAL_MOUNTS.offset, description="largest offset of a mount, metres, each axis"
    )
    angle_deg: Annotated[Degrees, Field(ge=0)] = Field(
        REAL_MOUNTS.angle_deg, description="largest rotation of a mount, degrees, about each axis"
    )
    scenes: dict[Name, dict[str, Any]] = Field(
        default={}, description="name -> key paths of `scene` to change: other towns, densities"
    )


class VerifySettings(Settings):
    """Detectors for the winners and the paper's rigs."""

    top: CountFromOne = Field(3, description="number of placements to train")
    seeds: tuple[Seed, ...] = Field((1, 2, 3), min_length=1, description="trainings of each")
    set: dict[str, Any] = Field(default={}, description="key path -> value for this sweep only")


class SearchFile(Common, Point):
    """A configuration file of a search as a whole."""

    mounting_errors: MountingErrorSettings = Field(
        REAL_MOUNTS,
        description="mounting errors in simulated clouds; real rigs perform worse than "
        "on paper alone",
    )
    placement: Name = Field("line", description="not for searches, which have search.start")
    search: SearchSettings = Field(description="zones, constraints, objective and sampler")
    robustness: RobustnessSettings | None = Field(
        RobustnessSettings(), description="sensitivity of the winner; null: skip"
    )
    verify: VerifySettings | None = Field(
        None, description="detectors for the winners and the paper's eight; null: none"
    )

    @field_validator("search", mode="before")
    @classmethod
    def _on_poles(cls, search: Any, info: ValidationInfo) -> Any:
        """Let the search of a site have no vehicle, not a car, and strips along kerbs."""
        site = info.data.get("site")
        if site is None or not isinstance(search, dict):
            return search
        if search.get("vehicle") not in (None, []):
            raise InputError("a site has no vehicle", key="vehicle", fix="remove it or site")
        search, roi = search | {"vehicle": []}, info.data.get("roi")
        if "zones" in search and roi and (scene := info.data.get("scene")):
            region = {"x": roi.x, "y": roi.y}
            search["zones"] = with_strips(search["zones"], scene, site, region, "zones.")
        return search

    @property
    def needs_voxels(self) -> bool:
        """Whether an objective depends on traffic; price, power and margin do not."""
        return any(o.of_traffic or o.measured for o in self.search.objective)

    @model_validator(mode="after")
    def _is_measured(self) -> SearchFile:
        for part in (part for objective in self.search.objective for part in objective.parts):
            if part.measured and part.by not in (*METRICS.own, *self.metrics):
                raise InputError(f"{part.by} is not among metrics", key="search.objective")
        return self
