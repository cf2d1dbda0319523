"""Data sheets of the LiDARs that can be bought, by name."""

import difflib
import re
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Self

import yaml
from pydantic import BaseModel, ConfigDict, PositiveFloat, PositiveInt, model_validator

from lidarplace.base.errors import InputError

FRAMES_PER_S = 10
RATES = (1, 100)  # turns a second


class _Sheet(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Source(_Sheet):
    """A document from which a number was read."""

    title: str
    url: str


class Rosette(_Sheet):
    """Two turning prisms, which draw a pattern that does not repeat."""

    rpm: tuple[float, float]  # turns of either prism a minute, signed
    field_of_view_deg: PositiveFloat  # of the cone that they fill


class Datasheet(_Sheet):
    """Data of a LiDAR model; None if no source has it."""

    name: str  # in settings and for `Lidar.named`
    maker: str
    model: str
    elevations_deg: tuple[float, ...] = ()  # of every beam, ascending; none of a rosette
    offsets_m: tuple[float, ...] | None = None  # of every laser along the sensor's z axis
    azimuth_deg: tuple[float, float] = (-180.0, 180.0)  # field of view [min, max), 0 ahead
    azimuth_steps: PositiveInt = 1  # firings of a beam in a turn of 360 degrees, at FRAMES_PER_S
    rosette: Rosette | None = None  # in place of beams that turn
    range: PositiveFloat  # farthest return of any surface, metres
    range_10: PositiveFloat | None = None  # of a surface that reflects 10 %, metres
    range_80: PositiveFloat | None = None  # of one that reflects 80 %
    min_range: PositiveFloat | None = None  # of the nearest return, metres
    range_noise: PositiveFloat | None = None  # standard deviation, metres, where given as such
    accuracy: PositiveFloat | None = None  # plus or minus, metres, as given: mostly a bound
    points_per_second: PositiveInt | None = None  # one return of each ray
    wavelength_nm: PositiveFloat | None = None
    size_mm: tuple[PositiveFloat, PositiveFloat, PositiveFloat] | None = None
    """Length, width and height; the diameter twice for a cylinder."""
    mass_kg: PositiveFloat | None = None  # without cables
    power_w: PositiveFloat | None = None  # of usual work
    price_usd: PositiveFloat | None = None  # what a source asked for one
    sources: tuple[Source, ...]  # where these numbers were read
    approximate: tuple[str, ...] = ()  # which are not the sensor's own, and why

    @model_validator(mode="after")
    def _beams_or_rosette(self) -> Self:
        if bool(self.elevations_deg) == (self.rosette is not None):
            raise InputError("either beams or a rosette", key=self.name)
        if self.rosette is not None and self.points_per_second is None:
            raise InputError("a rosette needs points_per_second", key=self.name)
        return self

    @property
    def rays(self) -> int:
        """Number of rays of a frame."""
        if not self.elevations_deg:
            return (self.points_per_second or 0) // FRAMES_PER_S
        low, high = self.azimuth_deg
        return len(self.elevations_deg) * round(self.azimuth_steps * (high - low) / 360)


def metres(size_mm: tuple[float, float, float]) -> tuple[float, float, float]:
    """Convert a size to metres."""
    length, width, height = size_mm
    return 1e-3 * length, 1e-3 * width, 1e-3 * height


@cache
def catalogue() -> Mapping[str, Datasheet]:
    """Return all data sheets by name, in the order of the file."""
    text = files(__package__).joinpath("datasheets.yaml").read_text(encoding="utf-8")
    return {name: Datasheet(name=name, **fields) for name, fields in yaml.safe_load(text).items()}


def datasheet(name: str) -> Datasheet:
    """Return the data sheet of that name; case, hyphens and blanks do not matter.

    "VLP-16" is "vlp16". "hdl32e@20hz" is the same LiDAR at 20 turns a second, with as many firings
    in all. Raises ValueError: there is none, it does not turn, or not at that rate."""
    name, at, rate = name.partition("@")
    if at:
        return _at_rate(datasheet(name), rate)
    names = {_bare(sheet): sheet for sheet in catalogue()}
    if _bare(name) in names:
        return catalogue()[names[_bare(name)]]
    if close := difflib.get_close_matches(_bare(name), names, n=3):
        hint = f"did you mean {' or '.join(names[key] for key in close)}?"
        raise InputError(f"unknown LiDAR {name!r}", fix=hint)
    raise InputError(f"unknown LiDAR {name!r}", expected=f"one of {', '.join(catalogue())}")


@cache
def _at_rate(sheet: Datasheet, rate: str) -> Datasheet:
    """Return a LiDAR at another rate, such as "20hz"."""
    number = re.fullmatch(r"(\d+(?:\.\d+)?)\s*hz", rate.strip().lower())
    if number is None or not RATES[0] <= float(number[1]) <= RATES[1]:
        allowed = f"{RATES[0]} to {RATES[1]} Hz, such as {sheet.name}@20hz"
        raise InputError(f"rate of {sheet.name}", expected=allowed, found=repr(rate))
    if sheet.rosette is not None:
        wrong = f"{sheet.name} has a pattern that does not turn"
        raise InputError(wrong, fix=f"leave @{rate} out")
    steps = round(sheet.azimuth_steps * FRAMES_PER_S / float(number[1]))
    name = f"{sheet.name}@{float(number[1]):g}hz"
    return sheet.model_copy(update={"name": name, "azimuth_steps": steps})


def _bare(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())
