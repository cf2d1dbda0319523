"""File of a correction: the losses of LiDARs of a real vehicle, learnt from its recordings."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any

import yaml
from pydantic import BeforeValidator, Field, Strict, model_validator

from lidarplace.base.class_names import check_among
from lidarplace.base.errors import InputError
from lidarplace.base.suggestions import did_you_mean
from lidarplace.configuration.settings import (
    ClassName,
    CountFromOne,
    Distance,
    Elevation,
    Name,
    Probability,
    Settings,
    validated,
)
from lidarplace.configuration.yaml import parse_yaml, read_yaml_file
from lidarplace.files.atomic import write_text
from lidarplace.logs.boxes import CLASSES
from lidarplace.rigs.correction import MOST_FACTOR, OTHER, Correction, Mask
from lidarplace.rigs.lidar import MOST_OFFSET, Lidar

PACKAGED = "lidarplace.rigs.corrections"
MOST_SHARES = 100_000  # of a mask: half a degree in both directions is less


def _one_row(shares: Any) -> Any:
    flat = isinstance(shares, (list, tuple)) and not any(
        isinstance(s, (list, tuple)) for s in shares
    )
    return [shares] if flat else shares


Shares = Annotated[tuple[Probability, ...], Field(min_length=1, max_length=MOST_SHARES)]
Rows = Annotated[tuple[Shares, ...], Field(min_length=1, max_length=180), BeforeValidator(_one_row)]
Offset = Annotated[float, Strict(), Field(ge=-MOST_OFFSET, le=MOST_OFFSET, allow_inf_nan=False)]
ClassFactor = Annotated[float, Strict(), Field(ge=0, le=MOST_FACTOR, allow_inf_nan=False)]


class MaskSettings(Settings):
    """Share of the rays that return, by direction in the sensor's frame."""

    azimuth_deg: Annotated[float, Strict(), Field(gt=0, le=360, allow_inf_nan=False)] = Field(
        description="width of a bin of azimuth, degrees; the first one begins at -180"
    )
    elevation_deg: tuple[Elevation, ...] = Field(
        (), description="elevations between rows, ascending, degrees; none for a single row"
    )
    shares: Rows = Field(
        description="rows, the lowest first, of a share for each bin of azimuth, growing to the "
        "left; a single row needs no list around it"
    )

    @model_validator(mode="after")
    def _build(self) -> MaskSettings:
        for row in self.shares:
            if not math.isclose(len(row) * self.azimuth_deg, 360.0, rel_tol=1e-6):
                bins = f"{360 / self.azimuth_deg:.6g} for bins of {self.azimuth_deg:g} degrees"
                raise InputError(key="shares", expected=bins, found=len(row))
        self.mask()  # its errors are errors of the settings
        return self

    def mask(self) -> Mask:
        """Build the mask, in radians."""
        return Mask(self.shares, tuple(map(math.radians, self.elevation_deg)))


class UnitSettings(Settings):
    """One LiDAR of the vehicle."""

    azimuth_steps: CountFromOne | None = Field(None, description="firings of a beam per turn")
    elevations_deg: tuple[Elevation, ...] | None = Field(
        None, min_length=1, description="elevation of every beam, lowest first, degrees"
    )
    offsets_m: tuple[Offset, ...] | None = Field(
        None, min_length=1, description="offset of every laser along the sensor's z axis, metres"
    )
    mask: MaskSettings | None = Field(None, description="its shadow; null: none")


class CorrectionFile(Settings):
    """Losses of the LiDARs of a real vehicle."""

    factor: dict[ClassName, ClassFactor] = Field(
        default={},
        description=f"share of the rays on objects of a class that return; {OTHER}: of the other "
        "classes, 1 by default",
    )
    classes: tuple[ClassName, ...] = Field(
        (), description=f"classes of the logs other than {', '.join(CLASSES)} that have a factor"
    )
    distance: Distance | None = Field(
        None, gt=0, description="metres after which 1/e of the rays on objects return; null: all do"
    )
    lidars: dict[Name, UnitSettings] = Field(
        default={}, description="LiDARs by their name in the rig as it was recorded"
    )
    fitted: dict[str, Any] = Field(default={}, description="facts about the fit, for readers")

    @model_validator(mode="after")
    def _build(self) -> CorrectionFile:
        fix = "list it in classes if your logs have it"
        check_among(self.factor, (*CLASSES, OTHER, *self.classes), key="factor", fix=fix)
        self.correction()  # its errors are errors of the settings
        return self

    def correction(self, mask: Mask | None = None) -> Correction:
        """Build the losses of all LiDARs of the vehicle, and the mask of one."""
        return Correction(tuple(self.factor.items()), self.distance, mask)

    def applied_to(self, lidar: Lidar, unit: str | None = None) -> Lidar:
        """Apply the losses to a LiDAR; see `Lidar.corrected`.

        See `Lidar.corrected`.

        Raises ValueError: there is no such unit, or its beams are not those of `lidar`."""
        if unit is not None and unit not in self.lidars:
            names = ", ".join(self.lidars) or "none: it holds for all LiDARs"
            wrong = f"no LiDAR model {unit!r}{did_you_mean(unit, self.lidars)}"
            raise InputError(wrong, key="unit", expected=f"one of {names}")
        settings = UnitSettings() if unit is None else self.lidars[unit]
        values: dict[str, Any] = {
            "azimuth_steps": settings.azimuth_steps,
            "elevations": settings.elevations_deg
            and tuple(map(math.radians, settings.elevations_deg)),
            "offsets": settings.offsets_m,
        }
        values = {name: value for name, value in values.items() if value is not None}
        if values and lidar.pattern is not None:
            wrong = "has beams that turn, and the LiDAR has a pattern"
            raise InputError(wrong, key=f"unit {unit}")
        for table in (settings.elevations_deg, settings.offsets_m):
            if table is not None and len(table) != lidar.beams:
                beams = f"{lidar.beams} beams as the LiDAR has"
                raise InputError(key=f"unit {unit}", expected=beams, found=len(table))
        mask = None if settings.mask is None else settings.mask.mask()
        return replace(lidar, correction=self.correction(mask), **values)


def packaged() -> tuple[str, ...]:
    """List the names of the corrections that the package has."""
    names = (path.name for path in files(PACKAGED).iterdir())
    return tuple(sorted(name.removesuffix(".yaml") for name in names if name.endswith(".yaml")))


def is_file(source: str) -> bool:
    """Return whether a text is the path of a correction, not a name of the package."""
    return source.endswith((".yaml", ".yml"))


def read_correction(source: str | Path) -> CorrectionFile:
    """Read the correction in a YAML file, again when it was changed, or a packaged one by name.

    Raises ValueError: there is none of that name, the file cannot be read, or a value is wrong."""
    name = str(source)
    if not is_file(name):
        return _packaged(name)
    try:
        status = Path(source).stat()
        return _read(Path(source), status.st_mtime_ns, status.st_size)
    except OSError as error:
        raise InputError(str(error.strerror), place=name) from None


def write_correction(path: Path, file: CorrectionFile) -> None:
    """Write a correction as `read_correction` reads it; it is renamed into place."""
    content = file.model_dump(mode="json", exclude_defaults=True)
    write_text(path, yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=100))


@lru_cache(maxsize=8)
def _read(path: Path, changed: int, size: int) -> CorrectionFile:
    return validated(CorrectionFile, read_yaml_file(path), str(path))


@lru_cache(maxsize=8)
def _packaged(name: str) -> CorrectionFile:
    if name not in packaged():
        wrong = f"no correction is called {name!r}{did_you_mean(name, packaged())}"
        raise InputError(wrong, expected=", ".join((*packaged(), "a FILE.yaml")))
    text = files(PACKAGED).joinpath(f"{name}.yaml").read_text(encoding="utf-8")
    return validated(CorrectionFile, parse_yaml(text), name)
