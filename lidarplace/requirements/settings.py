"""Requirements in a configuration: what has to be seen where, and how much of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, Literal, get_args

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from lidarplace.base.sectors import SECTORS, bounds_of
from lidarplace.configuration.mounting_errors import OffsetSettings
from lidarplace.configuration.settings import (
    CountFromOne,
    Distance,
    Length,
    Name,
    Probability,
    Settings,
    Turn,
    short_for,
)
from lidarplace.configuration.weather import WeatherSettings
from lidarplace.logs.plausible import MOST_SIZE_M
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.recall.detection_curve import IOU, DetectionCurves
from lidarplace.requirements.area import Area
from lidarplace.requirements.requirement import (
    STANDARD,
    AlsoWhen,
    Measure,
    PlacedObject,
    Requirement,
    measured,
)
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement

LANES = ("right", "own", "left")


def _ordered(interval: tuple[float, float]) -> tuple[float, float]:
    if not interval[0] < interval[1]:
        raise ValueError("allowed is [min, max] with min < max")
    return interval


def _direction(value: Any) -> Any:
    """A sector's name as the angles of its ends."""
    if not isinstance(value, str):
        return value
    if value not in SECTORS:
        raise ValueError(f"allowed are {', '.join(SECTORS)} and [from, to] in degrees")
    return bounds_of(SECTORS.index(value))


Interval = Annotated[tuple[Length, Length], AfterValidator(_ordered)]
Sector = Annotated[Turn, BeforeValidator(_direction)]


class WhereSettings(Settings):
    """The ground on which an object may stand with its middle: what all of these keys allow."""

    preset: Literal[PRESETS] | None = Field(  # type: ignore[valid-type]
        None, description="an area that follows a UN Regulation, in place of the other keys"
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
        None,
        description="lanes along x, in place of y; the vehicle drives in the middle of its own",
    )
    lane_width: Distance = Field(3.5, gt=0, description="metres")
    z: Interval = Field((0.0, 2.0), description="heights of a coverage, metres")

    @model_validator(mode="after")
    def _one_way(self) -> WhereSettings:
        others = self.model_fields_set - {"preset", "z"}
        if self.preset is not None and others:
            raise ValueError(f"preset: stands alone; take out {', '.join(sorted(others))}")
        if self.lanes is not None and self.y is not None:
            raise ValueError("lanes: stand in place of y; take one of them out")
        return self

    def area(self, vehicle: Vehicle) -> Area:
        """The area around this vehicle. Raises ValueError as `preset` does."""
        if self.preset is not None:
            return preset(self.preset, vehicle)
        y = () if self.y is None else (self.y,)
        for lane in self.lanes or ():
            middle = (LANES.index(lane) - 1) * self.lane_width
            y = (*y, (middle - 0.5 * self.lane_width, middle + 0.5 * self.lane_width))
        return Area(self.x, y, self.distance, self.sectors or ())


Side = Annotated[Distance, Field(le=MOST_SIZE_M)]
"""Of an object; centimetres and millimetres are mostly beyond."""


class WhatSettings(Settings):
    """An object: a class's standard box, a box of a given size, or the one changed by the other."""

    object_class: Literal[tuple(STANDARD)] | None = Field(  # type: ignore[valid-type]
        None, alias="class", description="its standard box, and its detection curve"
    )
    length: Side | None = Field(None, gt=0, description="metres")
    width: Side | None = Field(None, gt=0, description="metres")
    height: Side | None = Field(None, gt=0, description="metres")
    reflectivity: Probability | None = Field(
        None,
        gt=0,
        description="share of the light that it sends back, 0.1 if null; every LiDAR has to have a "
        "range_10 then",
    )
    headings: Annotated[CountFromOne, Field(le=360)] = Field(
        4, description="so many, evenly over half a turn; the worst one counts"
    )

    @model_validator(mode="after")
    def _has_a_size(self) -> WhatSettings:
        missing = [key for key in ("length", "width", "height") if getattr(self, key) is None]
        if self.object_class is None and missing:
            raise ValueError(f"name a class, or {', '.join(missing)}, too")
        return self

    def placed(self) -> PlacedObject:
        """In the terms of `lidarplace`."""
        known = STANDARD[self.object_class] if self.object_class else PlacedObject(0.0, 0.0, 0.0)
        given = self.model_dump(exclude={"object_class"}, exclude_none=True)
        return replace(known, **given)


class AtLeastSettings(Settings):
    """How much of it is needed; one of the first four keys."""

    points: CountFromOne | None = Field(None, description="returns from the object")
    cells: CountFromOne | None = Field(
        None, description="distinct cells of its surface, cubes of the edge that the curves have"
    )
    probability: Probability | None = Field(
        None, gt=0, description="that a detector finds it, by the curve of its class"
    )
    coverage: Probability | None = Field(
        None, gt=0, description="share of the voxels above the area that some beam crosses"
    )
    iou: Probability = Field(IOU, gt=0, lt=1, description="overlap that a detection must exceed")
    sensors: CountFromOne | None = Field(
        None,
        description="so many sensors have that much, each by itself; null: all LiDARs together",
    )

    @model_validator(mode="after")
    def _one(self) -> AtLeastSettings:
        if sum(getattr(self, key) is not None for key in get_args(Measure)) != 1:
            raise ValueError("name one of points, cells, probability and coverage")
        return self

    @property
    def measure(self) -> Measure:
        """Which of them."""
        return next(key for key in get_args(Measure) if getattr(self, key) is not None)

    @property
    def measured(self) -> str:
        """The same for tables."""
        return measured(self.measure, self.sensors)


class MountsOffSettings(OffsetSettings):
    """Rigs with every mount off, uniform and independent for each coordinate."""

    draws: CountFromOne = Field(8, description="so many rigs are drawn; each has to do")

    @model_validator(mode="after")
    def _some(self) -> MountsOffSettings:
        if not self.errors():
            raise ValueError("name offset or angle_deg; both are 0")
        return self


class AlsoWhenSettings(Settings):
    """Cases beside the rig as it is built; each by itself, not all at once."""

    one_lidar_dead: bool = Field(False, description="any one of the LiDARs sees nothing")
    sensors_dead: CountFromOne | None = Field(
        None, description="any so many of the sensors see nothing at once"
    )
    range_factor: Probability | None = Field(
        None, gt=0, description="every LiDAR reaches so much of its range, range_10 and range_80"
    )
    weather: WeatherSettings | None = Field(
        None,
        description="fog or rain, which shorten the range of every LiDAR; rays that end at drops "
        "are not modelled",
    )
    mounts_off: MountsOffSettings | None = Field(None, description="mounts are not where planned")

    def cases(self) -> AlsoWhen:
        """In the terms of `lidarplace`."""
        off = self.mounts_off
        return AlsoWhen(
            self.one_lidar_dead,
            self.range_factor,
            None if self.weather is None else self.weather.weather(),
            None if off is None else off.errors(),
            0 if off is None else off.draws,
            self.sensors_dead or 0,
        )

    @model_validator(mode="after")
    def _dead_once(self) -> AlsoWhenSettings:
        if self.one_lidar_dead and self.sensors_dead is not None:
            raise ValueError("one_lidar_dead and sensors_dead: name one of the two")
        return self


class RequirementSettings(Settings):
    """What has to be seen where."""

    name: Name = Field(description="for tables and pictures")
    where: Annotated[WhereSettings, short_for("preset")] = Field(
        description="a text is short for preset"
    )
    what: Annotated[WhatSettings, short_for("class")] | None = Field(
        None, description="what stands there; a text is short for class; none for coverage"
    )
    at_least: AtLeastSettings = Field(description="how much of it is needed")
    share: Probability = Field(
        1.0, alias="for", gt=0, description="share of the positions; 1: the worst one, too"
    )
    also_when: AlsoWhenSettings = Field(
        AlsoWhenSettings(), description="cases in which it holds, too"
    )
    step: Distance = Field(
        0.25, gt=0, description="metres between positions, or edge of a voxel of coverage"
    )

    @model_validator(mode="after")
    def _fits(self) -> RequirementSettings:
        if self.at_least.measure == "coverage":
            if self.what is not None or "share" in self.model_fields_set:
                raise ValueError("at_least: coverage is of all voxels; take out what and for")
            return self
        if "z" in self.where.model_fields_set:
            raise ValueError("where.z: is of coverage; an object stands on the ground")
        if self.what is None:
            raise ValueError(f"what: is missing; {self.at_least.measure} are of an object")
        if self.at_least.measure == "probability" and self.what.object_class is None:
            raise ValueError("what: a probability needs a class, which has a detection curve")
        return self

    def not_of(self, lidar: Lidar) -> tuple[str, str] | None:
        """Why it cannot be asked of a LiDAR: the key, and what is missing or wrong.

        None if it can. By light nobody knows how far a LiDAR without `range_10` sees; a case of
        `also_when` may leave one no range.
        """
        if self.what is not None and self.what.reflectivity is not None and lidar.range_10 is None:
            told = "has no range_10, by which light counts; give it one, or leave this key out"
            return "what.reflectivity", told
        try:
            self.also_when.cases().variants(Placement("one", [Mount()], lidar))
        except ValueError as error:
            return "also_when", str(error)
        return None

    def requirement(self, vehicle: Vehicle, curves: DetectionCurves) -> Requirement:
        """In the terms of `lidarplace`.

        Raises ValueError: the vehicle has no body that a preset lies around, or there is no curve.
        """
        wanted, placed = self.at_least, None if self.what is None else self.what.placed()
        curve = None
        if wanted.measure == "probability" and placed is not None:
            curve = curves.of(str(placed.object_class), wanted.iou)
        return Requirement(
            name=self.name,
            area=self.where.area(vehicle),
            measure=wanted.measure,
            least=float(getattr(wanted, wanted.measure)),
            placed=placed,
            share=self.share,
            step=self.step,
            heights=self.where.z,
            curve=curve,
            cell=curves.cell,
            also_when=self.also_when.cases(),
            sensors=wanted.sensors,
        )


def _each_once(requirements: tuple[RequirementSettings, ...]) -> tuple[RequirementSettings, ...]:
    names = [requirement.name for requirement in requirements]
    if len(set(names)) < len(names):
        raise ValueError(f"each name once, found {', '.join(names)}")
    return requirements


Requirements = Annotated[tuple[RequirementSettings, ...], AfterValidator(_each_once)]
"""Each has a name of its own."""


PRESETS = ("un_r151", "un_r158", "un_r159")


def preset(name: str, vehicle: Vehicle) -> Area:
    """The area of a preset around this vehicle.

    - `un_r151`: to the right of the whole vehicle, 0.9 to 4.25 m from its side.
    - `un_r158`: behind the vehicle, as wide as it, from 0.2 to 3.5 m.
    - `un_r159`: before the vehicle, as wide as it, from 0.8 to 3.7 m.

    Raises:
        ValueError: there is no preset of that name, or the vehicle has no body.
    """
    if name not in PRESETS:
        raise ValueError(f"where.preset: found {name!r}; allowed are {', '.join(PRESETS)}")
    if not len(vehicle.extents):
        raise ValueError(
            f"where.preset: {name} lies around the vehicle's body, and the vehicle has none"
        )
    rear, right, _ = vehicle.extents[:, 0].min(axis=0).tolist()
    front, left, _ = vehicle.extents[:, 1].max(axis=0).tolist()
    if name == "un_r151":
        return Area(x=(rear, front), y=((right - 4.25, right - 0.9),))
    if name == "un_r158":
        return Area(x=(rear - 3.5, rear - 0.2), y=((right, left),))
    return Area(x=(front + 0.8, front + 3.7), y=((right, left),))
