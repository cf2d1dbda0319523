"""A LiDAR model in a configuration: degrees and metres."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, Strict, ValidationInfo, field_validator, model_validator

from lidarplace.base.errors import InputError, at
from lidarplace.configuration.correction import Offset, is_file, read_correction
from lidarplace.configuration.pattern_file import read_pattern
from lidarplace.configuration.settings import (
    CountFromOne,
    Degrees,
    Distance,
    Elevation,
    FileBeside,
    Name,
    Probability,
    Settings,
    Text,
    Turn,
    beside_the_file,
)
from lidarplace.rigs.catalogue.datasheet import datasheet, metres
from lidarplace.rigs.lidar import Lidar, pattern_in
from lidarplace.rigs.scan_timing import ScanTiming

Side = Annotated[float, Strict(), Field(ge=1, le=2000, allow_inf_nan=False)]
"""Side of a LiDAR, millimetres; metres are below."""

Aside = Annotated[float, Strict(), Field(ge=-180, le=180, allow_inf_nan=False)]
"""Degrees of a beam beside the azimuth step."""

MOST_BEAMS = 10_000
MOST_RAYS = 20_000_000
"""Rays of a turn: two hundred times the paper's, beyond which a mistyped number is likelier."""
TURNING = {"azimuth_deg", "azimuth_steps", "beams", "elevation_deg", "elevations_deg", "offsets_m"}
TURNING |= {"azimuth_offsets_deg"}
"""Keys of a LiDAR whose beams turn."""
TIMING = {"phase_deg", "direction", "ego_compensation"}
"""Keys of a LiDAR that takes time for a frame."""
LOSSES = ("range_noise", "drop_off")
"""Keys that other LiDARs of a file share, unless their settings or the catalogue have them."""
Losses = tuple[tuple[str, float], ...]
"""Values of some of `LOSSES`, by key."""
ANY = ("range", "range_10", "range_80", "min_range", "range_noise", "wavelength_nm", "size_mm")
"""Keys that data sheets of any LiDAR may have."""


def _beside_or_packaged(source: str, info: ValidationInfo) -> str:
    """Resolve the path of a file; a packaged name stays as it is."""
    return str(beside_the_file(Path(source), info)) if is_file(source) else source


class SensorSettings(Settings):
    """LiDAR model: a name in the catalogue, alone or with keys that override it, or your own.

    The defaults are the paper's, without noise."""

    name: Name | None = Field(
        None,
        description="name in the catalogue (`lidarplace sensors`), such as vlp16; at 10 turns per "
        "second, unless the name has another rate: hdl32e@20hz",
    )
    beams: Annotated[CountFromOne, Field(le=MOST_BEAMS)] = Field(
        16, description="beams, evenly spread over elevation_deg"
    )
    elevation_deg: tuple[Elevation, Elevation] = Field(
        (-25.0, 5.0), description="elevation of the lowest and the highest beam, degrees"
    )
    elevations_deg: Annotated[tuple[Elevation, ...], Field(max_length=MOST_BEAMS)] | None = Field(
        None, description="elevation of every beam, degrees, instead of the two keys above"
    )
    offsets_m: Annotated[tuple[Offset, ...], Field(max_length=MOST_BEAMS)] | None = Field(
        None,
        description="offset of the laser of every beam along the sensor's z axis, where its rays "
        "start, metres; null: all start at the origin",
    )
    azimuth_offsets_deg: Annotated[tuple[Aside, ...], Field(max_length=MOST_BEAMS)] | None = Field(
        None,
        description="offset of every beam from the azimuth steps, degrees, positive to the left; "
        "null: all fire at the steps",
    )
    azimuth_steps: CountFromOne = Field(5625, description="firings of a beam per turn")
    range: Distance = Field(100.0, gt=0, description="farthest return, metres")
    range_10: Distance | None = Field(
        None, gt=0, description="farthest return of a surface that reflects 10 %, metres; null: any"
    )
    range_80: Distance | None = Field(
        None,
        gt=0,
        description="the same for 80 %; null: by range_10 and the inverse square of the distance",
    )
    min_range: Distance = Field(0.0, description="nearest return, metres")
    range_noise: Distance = Field(0.0, description="standard deviation, m")
    drop_off: Probability = Field(0.0, lt=1, description="probability that a return is lost")
    wavelength_nm: Annotated[float, Strict(), Field(gt=0, le=100_000, allow_inf_nan=False)] = Field(
        905.0, description="wavelength, nanometres; thin fog dims long waves less"
    )
    window: Probability = Field(
        1.0, gt=0, description="share of the light that a soiled front window lets pass, each way"
    )
    size_mm: tuple[Side, Side, Side] | None = Field(
        None,
        description="length, width and height of the housing, which blocks rays of other "
        "LiDARs, millimetres; the diameter twice for a cylinder; null: it hides "
        "nothing",
    )
    azimuth_deg: Turn = Field(
        (-180.0, 180.0),
        description="horizontal field of view in the sensor's frame, degrees, without max itself; "
        "0 is its x axis, positive angles are to the left, and the interval may cross 180",
    )

    pattern: FileBeside | None = Field(
        None,
        description="CSV file of the rays in the order of firing, for a LiDAR whose pattern does "
        "not repeat, in place of beams and azimuths: columns azimuth_deg and elevation_deg, or "
        "Azimuth/deg and Zenith/deg; relative to the folder of the configuration",
    )
    pattern_rays: Annotated[CountFromOne, Field(le=MOST_RAYS)] | None = Field(
        None,
        description="rays per frame; the next frame continues in the file; null: the whole file",
    )

    rate_hz: Annotated[float, Strict(), Field(gt=0, le=1000, allow_inf_nan=False)] | None = Field(
        None,
        description="frames per second of a scan that takes time: in simulated clouds objects and "
        "vehicle move between its rays; null: all rays are fired at the moment of the frame",
    )
    phase_deg: Degrees | Literal["free"] = Field(
        0.0,
        description="azimuth to which the LiDAR points at the moment of the frame, degrees in its "
        "own frame; free: another one in every frame",
    )
    direction: Literal["left", "right"] = Field(
        "left", description="direction in which it turns; left is anticlockwise from above"
    )
    ego_compensation: bool = Field(
        True,
        description="true: points are moved to where the vehicle sees them at the moment of the "
        "frame; false: each is in the frame of the vehicle at the moment of its ray",
    )

    correction: Annotated[Text, AfterValidator(_beside_or_packaged)] | None = Field(
        None,
        description="YAML file of the losses on a real vehicle, relative to the folder of the "
        "configuration, or a name of the package's; null: it loses nothing",
    )
    unit: Name | None = Field(
        None,
        description="name of this LiDAR in the correction, whose beams and azimuth steps apply; "
        "null: none of them",
    )

    @model_validator(mode="before")
    @classmethod
    def _fill_from_catalogue(cls, data: Any) -> Any:
        name = data.get("name") if isinstance(data, dict) else None
        if not isinstance(name, str):
            return data
        sheet = datasheet(name)
        for key in sorted(TURNING & data.keys()):
            if sheet.rosette is not None:
                raise InputError(f"{name} has a pattern of its own and no beams", key=key)
            if key in ("beams", "elevation_deg"):
                raise InputError(f"{name} has its own beams; elevations_deg replaces them", key=key)
        keys = [*ANY]
        if sheet.rosette is None and data.get("pattern") is None:
            keys += ["elevations_deg", "azimuth_deg", "azimuth_steps"]
            table = data.get("elevations_deg")
            if not isinstance(table, (list, tuple)) or len(table) == len(sheet.elevations_deg):
                keys.append("offsets_m")  # else they are of other lasers
        return {key: v for key in keys if (v := getattr(sheet, key)) is not None} | data

    @field_validator("elevation_deg", "elevations_deg")
    @classmethod
    def _not_falling(cls, table: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if table is not None and len(table) > 1 and all(a > b for a, b in pairwise(table)):
            raise InputError(expected="rising elevations, the lowest first")
        return table

    @model_validator(mode="after")
    def _build(self) -> SensorSettings:
        if self.correction is None and self.unit is not None:
            raise InputError("needs correction", key="unit")
        if self.rate_hz is None and (keys := sorted(TIMING & self.model_fields_set)):
            raise InputError("needs rate_hz", key=keys[0])
        if self.pattern is None and self.pattern_rays is not None:
            raise InputError("needs pattern", key="pattern_rays")
        if self.pattern is not None and (keys := sorted(TURNING & self.model_fields_set)):
            wrong, fix = "a pattern has it for every ray", "remove one of the two"
            raise InputError(wrong, key=keys[0], fix=fix)
        if self.elevations_deg is not None and (self.model_fields_set & {"beams", "elevation_deg"}):
            wrong, fix = "replaces beams and elevation_deg", "name one or the two"
            raise InputError(wrong, key="elevations_deg", fix=fix)
        beams = len(self.elevations_deg) if self.elevations_deg is not None else self.beams
        if beams * self.azimuth_steps > MOST_RAYS:
            most = f"at most {MOST_RAYS:,} rays, beams times azimuth steps"
            rays = f"{self.azimuth_steps:,} with {beams:,} beams"
            raise InputError(key="azimuth_steps", expected=most, found=rays)
        self.lidar()  # its errors are errors of the settings
        return self

    @property
    def losses(self) -> Losses:
        """Values of `LOSSES` that are written here, not in the catalogue, for other LiDARs."""
        sheet = None if self.name is None else datasheet(self.name)
        values = ((key, getattr(self, key)) for key in LOSSES if key in self.model_fields_set)
        return tuple((key, v) for key, v in values if v != getattr(sheet, key, None))

    def lidar(self, losses: Losses = ()) -> Lidar:
        """Return the sensor in radians, built once, with those `losses` that its settings lack."""
        lacking: dict[str, Any] = {k: v for k, v in losses if k not in self.model_fields_set}
        return replace(self._built, **lacking) if lacking else self._built

    @cached_property
    def _built(self) -> Lidar:
        lidar = self._uncorrected()
        if self.correction is None:
            return lidar
        with at(key="correction"):
            file = read_correction(self.correction)
            with at(self.correction):
                return lidar.corrected(file, self.unit)

    def corrected(self, lidar: Lidar, name: str) -> Lidar:
        """Apply the correction of these settings to another LiDAR, as its unit `name` if it is one.

        Raises ValueError if the unit does not fit the LiDAR."""
        if self.correction is None:
            return lidar
        with at(key="correction"):
            file = read_correction(self.correction)
            return lidar.corrected(file, name if name in file.lidars else None)

    def _uncorrected(self) -> Lidar:
        pattern = None
        if self.pattern is not None:
            pattern = read_pattern(self.pattern, self.pattern_rays)
        elif self.name is not None:
            pattern = pattern_in(datasheet(self.name))
        degrees = self.elevations_deg
        if degrees is None:
            low, high = self.elevation_deg
            step = (high - low) / (self.beams - 1) if self.beams > 1 else 0.0
            degrees = tuple(low + i * step for i in range(self.beams))
        start, end = map(math.radians, self.azimuth_deg)
        phase = None if self.phase_deg == "free" else math.radians(self.phase_deg)
        timing = None
        if self.rate_hz is not None:
            timing = ScanTiming(self.rate_hz, phase, self.direction, self.ego_compensation)
        return Lidar(
            tuple(map(math.radians, degrees)),
            self.azimuth_steps if pattern is None else 1,
            self.range,
            self.range_noise,
            self.drop_off,
            (start, end),
            self.min_range,
            self.range_10,
            self.range_80,
            1e-9 * self.wavelength_nm,
            window=self.window,
            size=self.size_mm and metres(self.size_mm),
            pattern=pattern,
            offsets=self.offsets_m,
            azimuth_offsets=self.azimuth_offsets_deg
            and tuple(map(math.radians, self.azimuth_offsets_deg)),
            timing=timing,
        )
