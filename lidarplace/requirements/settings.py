"""Requirements in a configuration: what must be seen where, and how much of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    ValidationInfo,
    field_validator,
    model_validator,
)
from pydantic_core import PydanticCustomError

from lidarplace.base.errors import InputError
from lidarplace.base.sectors import SECTORS, bounds_of
from lidarplace.configuration.mounting import CommonViewSettings, OffsetSettings
from lidarplace.configuration.settings import (
    CountFromOne,
    Distance,
    Factor,
    Length,
    Name,
    Probability,
    Settings,
    Turn,
    short_for,
)
from lidarplace.configuration.weather import WeatherSettings
from lidarplace.logs.plausibility import MOST_SIZE_M
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.recall.detection_curve import IOU, DetectionCurves
from lidarplace.requirements.area import Area
from lidarplace.requirements.presets.read import PRESETS, preset, preset_file
from lidarplace.requirements.requirement import (
    KIND_OF,
    STANDARD,
    AlsoWhen,
    Measure,
    PlacedObject,
    Requirement,
    measured,
)
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement

_KEYS: tuple[Measure, ...] = ("points", "cells", "probability", "coverage", "pixels", "reach")
"""Keys of `at_least`."""
LANES = ("right", "own", "left")


def _ordered(interval: tuple[float, float]) -> tuple[float, float]:
    if not interval[0] < interval[1]:
        raise InputError(expected="[min, max] with min < max")
    return interval


def _direction(value: Any) -> Any:
    """Return the angles of the ends of a sector that is named."""
    if not isinstance(value, str):
        return value
    if value not in SECTORS:
        raise InputError(expected=f"one of {', '.join(SECTORS)}, or [from, to] in degrees")
    return bounds_of(SECTORS.index(value))


Interval = Annotated[tuple[Length, Length], AfterValidator(_ordered)]
Sector = Annotated[Turn, BeforeValidator(_direction)]


class WhereSettings(Settings):
    """The ground on which the middle of an object may be; all keys that are set must allow it."""

    preset: Literal[PRESETS] | None = Field(  # type: ignore[valid-type]
        None, description="an area that follows a regulation, instead of the other keys"
    )
    distance: Annotated[tuple[Distance, Distance], AfterValidator(_ordered)] | None = Field(
        None, description="from the vehicle's body as seen from above, metres"
    )
    sectors: Annotated[tuple[Sector, ...], Field(min_length=1)] | None = Field(
        None,
        description="directions from the ego frame's origin: [from, to] in degrees from the x axis "
        "to the left, or one of " + ", ".join(SECTORS),
    )
    x: Interval | None = Field(None, description="forward, metres")
    y: Interval | None = Field(None, description="to the left, metres")
    lanes: Annotated[tuple[Literal[LANES], ...], Field(min_length=1)] | None = Field(  # type: ignore[valid-type]
        None, description="lanes along x, instead of y; the vehicle drives in the middle of its own"
    )
    lane_width: Distance = Field(3.5, gt=0, description="metres")
    z: Interval = Field((0.0, 2.0), description="heights of a coverage, metres")

    @model_validator(mode="after")
    def _one_way(self) -> WhereSettings:
        others = ", ".join(sorted(self.model_fields_set - {"preset", "z"}))
        if self.preset is not None and others:
            raise InputError("excludes other keys", key="preset", fix=f"remove {others}")
        if self.lanes is not None and self.y is not None:
            raise InputError("exclude y", key="lanes", fix="remove one of the two")
        return self

    def area(self, vehicle: Vehicle) -> Area:
        """Return the area around this vehicle. Raises ValueError as `preset` does."""
        if self.preset is not None:
            return preset(self.preset, vehicle)
        y = [] if self.y is None else [self.y]
        for lane in self.lanes or ():
            centre = (LANES.index(lane) - 1) * self.lane_width
            y.append((centre - 0.5 * self.lane_width, centre + 0.5 * self.lane_width))
        return Area(self.x, tuple(y), self.distance, self.sectors or ())


Side = Annotated[Distance, Field(le=MOST_SIZE_M)]
"""Side of an object, metres; lengths in centimetres and millimetres are mostly beyond."""


class WhatSettings(Settings):
    """An object: a class's standard box, a box of a given size, or one with some sizes changed."""

    object_class: Literal[tuple(STANDARD)] | None = Field(  # type: ignore[valid-type]
        None, alias="class", description="its standard box, and its detection curve"
    )
    length: Side | None = Field(None, gt=0, description="metres")
    width: Side | None = Field(None, gt=0, description="metres")
    height: Side | None = Field(None, gt=0, description="metres")
    reflectivity: Probability | None = Field(
        None,
        gt=0,
        description="share of the light that it reflects, 0.1 if null; if set, every LiDAR needs "
        "a range_10",
    )
    headings: Annotated[CountFromOne, Field(le=360)] = Field(
        4, description="number of headings, evenly over half a turn; the worst one counts"
    )

    @model_validator(mode="after")
    def _has_a_size(self) -> WhatSettings:
        missing = [key for key in ("length", "width", "height") if getattr(self, key) is None]
        if self.object_class is None and missing:
            raise InputError(expected=f"a class, or {', '.join(missing)}, too")
        return self

    def placed(self) -> PlacedObject:
        """Return the object in the terms of `lidarplace`."""
        standard = STANDARD[self.object_class] if self.object_class else PlacedObject(0.0, 0.0, 0.0)
        changes = self.model_dump(exclude={"object_class"}, exclude_none=True)
        return replace(standard, **changes)


class AtLeastSettings(Settings):
    """Least amount to be seen: the first four keys are for LiDARs, one of them at most.

    `pixels` is for cameras, `reach` for radars."""

    points: CountFromOne | None = Field(None, description="returns from the object")
    cells: CountFromOne | None = Field(
        None, description="distinct cells of its surface, cubes of the edge that the curves have"
    )
    probability: Probability | None = Field(
        None, gt=0, description="probability that a detector finds it, by the curve of its class"
    )
    coverage: Probability | None = Field(
        None, gt=0, description="share of the voxels above the area that some beam crosses"
    )
    iou: Probability = Field(IOU, gt=0, lt=1, description="overlap that a detection must exceed")
    pixels: CountFromOne | None = Field(
        None,
        description="width or height of its visible part in a camera's image, pixels, "
        "whichever is smaller",
    )
    reach: Annotated[Factor, Field(gt=0)] | None = Field(
        None, description="range of a radar for such objects as a multiple of the distance; 1: seen"
    )
    sensors: CountFromOne | None = Field(
        None,
        description="number of sensors that each have that much; null: all LiDARs together, or as "
        "many as kinds",
    )
    kinds: Annotated[CountFromOne, Field(le=3)] = Field(
        1, description="number of kinds of these sensors: LiDARs, cameras and radars"
    )

    @model_validator(mode="after")
    def _one(self) -> AtLeastSettings:
        named = [key for key, _ in self.needs]
        of_lidars = [key for key in named if key not in KIND_OF]
        if not named or len(of_lidars) > 1:
            one = "one of points, cells, probability and coverage, pixels or reach"
            raise InputError(expected=one, found=", ".join(named) or "none")
        if "coverage" in named and (len(named) > 1 or self.kinds > 1):
            raise InputError("for LiDARs only", key="coverage", fix="remove pixels, reach, kinds")
        if self.kinds > len(named):
            most = f"at most {len(named)}, a measure for each (of LiDARs, pixels, reach)"
            raise InputError(key="kinds", expected=most, found=self.kinds)
        if (self.sensors or self.kinds) < self.kinds:
            least = f"at least kinds, {self.kinds}"
            raise InputError(key="sensors", expected=least, found=self.sensors)
        return self

    @property
    def needs(self) -> tuple[tuple[Measure, float], ...]:
        """Measures that are named and their least values, those of LiDARs first."""
        named = ((key, getattr(self, key)) for key in _KEYS)
        return tuple((key, float(need)) for key, need in named if need is not None)

    @property
    def measure(self) -> Measure:
        """Measure that is named, or "times the need" for several."""
        return self.needs[0][0] if len(self.needs) == 1 else "times the need"

    @property
    def by(self) -> int | None:
        """Number of sensors that need it; None: all LiDARs together."""
        alone = self.kinds > 1 or any(key in KIND_OF for key, _ in self.needs)
        return self.kinds if self.sensors is None and alone else self.sensors


class MountsOffSettings(OffsetSettings):
    """Rigs with every mount off, uniform and independent for each coordinate."""

    draws: CountFromOne = Field(
        8, description="number of random rigs; each must meet the requirement"
    )

    @model_validator(mode="after")
    def _some(self) -> MountsOffSettings:
        if not self.errors():
            raise InputError(expected="offset or angle_deg above 0")
        return self


class AlsoWhenSettings(Settings):
    """Cases in addition to the rig as built, one at a time."""

    one_lidar_dead: bool = Field(False, description="any one of the LiDARs sees nothing")
    sensors_dead: CountFromOne | None = Field(
        None, description="any so many of the sensors see nothing at once"
    )
    range_factor: Probability | None = Field(
        None, gt=0, description="every LiDAR reaches this share of its range, range_10 and range_80"
    )
    weather: WeatherSettings | None = Field(
        None,
        description="fog or rain, which shorten the range of every LiDAR; rays that end at drops "
        "are not modelled",
    )
    mounts_off: MountsOffSettings | None = Field(None, description="rigs with mounting errors")

    def cases(self) -> AlsoWhen:
        """Return the cases in the terms of `lidarplace`."""
        off, weather = self.mounts_off, None if self.weather is None else self.weather.weather()
        errors, draws = (off.errors(), off.draws) if off else (None, 0)
        dead = self.sensors_dead or 0
        return AlsoWhen(self.one_lidar_dead, self.range_factor, weather, errors, draws, dead)

    @model_validator(mode="after")
    def _dead_once(self) -> AlsoWhenSettings:
        if self.one_lidar_dead and self.sensors_dead is not None:
            raise InputError("excludes sensors_dead", key="one_lidar_dead", fix="remove one")
        return self


class RequirementSettings(Settings):
    """A requirement: what a rig must see, and where."""

    name: Name = Field(description="name in tables and pictures")
    common_view: CommonViewSettings | None = Field(
        None, description="common view of pairs of sensors, instead of all other keys except name"
    )
    where: Annotated[WhereSettings, short_for("preset")] | None = Field(
        None,
        validate_default=True,
        description="a text is short for preset; needed without common_view",
    )
    what: Annotated[WhatSettings, short_for("class")] | None = Field(
        None, description="the object; a text is short for class; none for coverage"
    )
    at_least: AtLeastSettings | None = Field(
        None,
        validate_default=True,
        description="how much of it must be seen; needed without common_view",
    )
    share: Probability = Field(
        1.0, alias="for", gt=0, description="share of the area; 1: the worst place, too"
    )
    also_when: AlsoWhenSettings = Field(
        AlsoWhenSettings(), description="further cases in which it must hold"
    )
    step: Distance = Field(
        0.25,
        gt=0,
        description="metres between positions, refined to 0.05 where a verdict is near its limit, "
        "or edge of a voxel of coverage",
    )

    @field_validator("where", "at_least")
    @classmethod
    def _needed(cls, value: Any, info: ValidationInfo) -> Any:
        if value is None and info.data.get("common_view", True) is None:
            raise PydanticCustomError("missing", "Field required")
        return value

    @property
    def least(self) -> float:
        """Amount of the measure that is needed."""
        if self.common_view is not None:
            return self.common_view.share
        assert self.at_least is not None
        needs = self.at_least.needs
        return needs[0][1] if len(needs) == 1 else 1.0

    @property
    def measured(self) -> str:
        """Measure as tables have it."""
        if self.common_view is not None:
            return "common view"
        assert self.at_least is not None
        return measured(self.at_least.measure, self.at_least.by, self.at_least.kinds)

    @model_validator(mode="after")
    def _fits(self) -> RequirementSettings:
        if self.common_view is not None:
            others = self.model_fields_set - {"name", "common_view"}
            if others:
                named = sorted(str(type(self).model_fields[key].alias or key) for key in others)
                fix = f"remove {', '.join(named)}"
                raise InputError("excludes other keys", key="common_view", fix=fix)
            return self
        assert self.at_least is not None
        assert self.where is not None
        if self.at_least.measure == "coverage":
            if self.what is None and "share" not in self.model_fields_set:
                return self
            raise InputError("coverage counts all voxels", key="at_least", fix="remove what, for")
        if "z" in self.where.model_fields_set:
            raise InputError("for coverage only; an object is on the ground", key="where.z")
        if self.what is None:
            raise InputError(key="what", expected=f"an object for {self.at_least.measure}")
        if self.at_least.probability is not None and self.what.object_class is None:
            raise InputError(key="what", expected="a class with a detection curve, for probability")
        return self

    def not_of(self, lidar: Lidar) -> tuple[str, str] | None:
        """Return why the requirement does not apply to a LiDAR: the key, and what is wrong.

        None if it applies. By light nobody knows how far a LiDAR without `range_10` sees; a case of
        `also_when` may leave one no range."""
        if self.what is not None and self.what.reflectivity is not None and lidar.range_10 is None:
            return "what.reflectivity", "has no range_10; set it, or remove this key"
        try:
            self.also_when.cases().variants(Placement("one", [Mount()], lidar))
        except ValueError as error:
            return "also_when", str(error)
        return None

    def requirement(self, vehicle: Vehicle, curves: DetectionCurves) -> Requirement:
        """Return the requirement in the terms of `lidarplace`.

        Raises ValueError: the vehicle has no body that a preset is around, or there is no curve."""
        if self.common_view is not None:
            view = self.common_view.view()
            return Requirement(self.name, Area(), "common view", view.share, common_view=view)
        wanted, placed = self.at_least, None if self.what is None else self.what.placed()
        assert wanted is not None
        assert self.where is not None
        curve = None
        if wanted.probability is not None and placed is not None:
            curve = curves.of(str(placed.object_class), wanted.iou)
        return Requirement(
            self.name, self.where.area(vehicle), wanted.measure, self.least, placed, self.share,
            self.step, self.where.z, curve, curves.cell, self.also_when.cases(),
            sensors=wanted.by, kinds=wanted.kinds,
            needs=wanted.needs if len(wanted.needs) > 1 else (),
        )  # fmt: skip


def _each_once(requirements: tuple[RequirementSettings, ...]) -> tuple[RequirementSettings, ...]:
    names = [requirement.name for requirement in requirements]
    if len(set(names)) < len(names):
        raise InputError("duplicate names", found=", ".join(names))
    return requirements


def _of_presets(value: Any) -> Any:
    """Replace texts by all requirements of a preset."""
    if not isinstance(value, (str, list, tuple)):
        return value
    settings: list[Any] = []
    for entry in [value] if isinstance(value, str) else value:
        settings += preset_file(entry).requirements if isinstance(entry, str) else (entry,)
    return settings


Requirements = Annotated[
    tuple[RequirementSettings, ...], AfterValidator(_each_once), BeforeValidator(_of_presets)
]
"""Requirements with a name of its own each; a text stands for all of a preset."""
