"""LiDARs as their makers' files describe them: beams of one unit, calibrated.

Ouster's metadata JSON (https://static.ouster.dev/sensor-docs), Velodyne's calibration as YAML of
ROS (velodyne_pointcloud) or as XML (VeloView), Hesai's angle correction as CSV."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.errors import InputError, at
from lidarplace.configuration.yaml import read_yaml_file
from lidarplace.files.columns import numbers
from lidarplace.files.json_file import read_json
from lidarplace.files.tables import read_csv
from lidarplace.files.xml import read_xml

MOST_BEAMS = 1024
HOUSING_MM = 1.0  # a smaller distance from the axis is of no account


@dataclass(frozen=True)
class MakerFile:
    """A LiDAR as its file describes it; None for what the file leaves open."""

    elevations_deg: NDArray[np.float64]  # ascending, shape (beams,)
    azimuth_offsets_deg: NDArray[np.float64]  # of the beams, > 0 to the left, shape (beams,)
    offsets_m: NDArray[np.float64] | None = None  # along the sensor's z axis, shape (beams,)
    azimuth_steps: int | None = None
    azimuth_deg: tuple[float, float] | None = None
    rate_hz: float | None = None
    model: str = ""
    left_out: tuple[str, ...] = ()
    """What the file says and a LiDAR of this project has not."""


def read_maker_file(path: Path) -> MakerFile:
    """Read a maker's file, by its suffix; ValueError if it cannot be read, or is none of these."""
    for suffix, read in _READERS.items():
        if path.name.lower().endswith(suffix):
            path.stat()
            return read(path)
    raise InputError("unknown format", place=path, expected=", ".join(_READERS))


def _made(
    elevations: Any, azimuths: Any, path: Path, offsets: Any = None, **parts: Any
) -> MakerFile:
    """Sort the beams, in degrees and metres, and check them."""
    up, aside = (np.asarray(values, np.float64) for values in (elevations, azimuths))
    if not 1 <= len(up) <= MOST_BEAMS or len(aside) != len(up):
        counts = f"{len(up)} elevations and {len(aside)} azimuths"
        raise InputError(place=path, expected=f"1 to {MOST_BEAMS} beams", found=counts)
    for name, values, most in (("elevation", up, 90.0), ("azimuth", aside, 180.0)):
        if (wrong := ~(np.abs(values) <= most)).any():
            beam, expected = int(np.argmax(wrong)), f"degrees within ±{most:g}"
            key, found = f"{name} of beam {beam + 1}", f"{values[beam]:g}"
            raise InputError(place=path, key=key, expected=expected, found=found)
    order = np.argsort(up, kind="stable")
    if offsets is not None:
        offsets = np.asarray(offsets, np.float64)[order]
        offsets = offsets if offsets.any() else None
    return MakerFile(up[order], aside[order], offsets, **parts)


def _ouster(path: Path) -> MakerFile:
    """Read Ouster's metadata: azimuths count clockwise, column 0 looks back."""
    content = read_json(path)
    if not isinstance(content, dict):
        raise InputError(place=path, expected="an object", found=type(content).__name__)
    parts = [value for value in content.values() if isinstance(value, dict)]

    def value(name: str) -> Any:
        return next((part[name] for part in (content, *parts) if name in part), None)

    names = ("beam_altitude_angles", "beam_azimuth_angles")
    tables = [_numbers(value(name), path, name) for name in names]
    columns, hertz = value("columns_per_frame"), None
    with suppress(ValueError):
        mode_columns, mode_hertz = map(int, str(value("lidar_mode")).split("x"))
        columns, hertz = columns or mode_columns, mode_hertz
    if columns is not None and not (type(columns) is int and 1 <= columns <= 100_000):
        expected = "a whole number from 1"
        raise InputError(place=path, key="columns_per_frame", expected=expected, found=columns)
    left_out = []
    for name, text in (
        ("lidar_origin_to_beam_origin_mm", "beams start {:g} mm off the axis"),
        ("lidar_to_sensor_transform", "the LiDAR's frame is {:g} mm above the sensor's"),
    ):
        length = value(name)
        if isinstance(length, list) and length and name.endswith("transform"):
            flat = np.asarray(length, object).ravel()
            length = flat[11] if len(flat) == 16 else None
        if isinstance(length, float | int) and abs(length) > HOUSING_MM:
            left_out.append(text.format(length))
    window, azimuth = value("column_window"), None
    if columns is not None and isinstance(window, list) and len(window) == 2:
        first, last = _numbers(window, path, "column_window")
        width = (last - first) % columns + 1
        if width < columns:
            start = 180.0 - 360.0 * first / columns
            azimuth = (start - 360.0 * width / columns, start)
    return _made(
        tables[0],
        -tables[1],
        path,
        azimuth_steps=columns,
        azimuth_deg=azimuth,
        rate_hz=hertz,
        model=str(value("prod_line") or ""),
        left_out=tuple(left_out),
    )


def _numbers(values: Any, path: Path, key: str) -> NDArray[np.float64]:
    good = isinstance(values, list) and all(type(value) in (int, float) for value in values)
    if not good or not np.isfinite(np.array(values, np.float64)).all():
        found = "none" if values is None else str(values)[:60]
        raise InputError(place=path, key=key, expected="a list of numbers", found=found)
    return np.array(values, np.float64)


_VELODYNE = (("vert", None), ("rot", 0.0), ("vert_offset", 0.0), ("horiz_offset", 0.0))
"""Corrections of a laser, and what they are where they are left out."""


def _velodyne_yaml(path: Path) -> MakerFile:
    """Read the lasers of velodyne_pointcloud: radians and metres, azimuths count clockwise.

    A laser's correction is subtracted from the azimuth, so it is to the left. Its vertical offset
    is at right angles to its rays, so these start farther off on the axis."""
    content = read_yaml_file(path)
    lasers = content.get("lasers") if isinstance(content, dict) else None
    if not isinstance(lasers, list) or not all(isinstance(laser, dict) for laser in lasers):
        keys = ", ".join(map(str, content)) if isinstance(content, dict) else "no mapping"
        raise InputError(place=path, key="lasers", expected="a list of lasers", found=keys[:100])
    up, aside, offsets, sideways = (
        _numbers(
            [laser.get(f"{key}_correction", default) for laser in lasers], path, f"{key}_correction"
        )
        for key, default in _VELODYNE
    )
    offsets, left_out = offsets / np.cos(up), _sideways(sideways)
    return _made(np.degrees(up), np.degrees(aside), path, offsets, left_out=left_out)


def _sideways(metres: NDArray[np.float64]) -> tuple[str, ...]:
    most = 1000 * float(np.abs(metres).max(initial=0.0))
    return (f"lasers are up to {most:.0f} mm beside the axis",) if most > HOUSING_MM else ()


def _velodyne_xml(path: Path) -> MakerFile:
    """Read the enabled lasers of VeloView's calibration: degrees and centimetres."""
    root = read_xml(path)
    names = ("vertCorrection_", "rotCorrection_", "vertOffsetCorrection_", "horizOffsetCorrection_")
    rows = []
    with at(path):
        for number, laser in enumerate(root.iter("px")):
            texts = [laser.findtext(name, "0" if n else "") for n, name in enumerate(names)]
            try:
                rows.append([float(text) for text in texts])
            except ValueError:
                found = ", ".join(map(repr, texts))
                expected = f"numbers of {', '.join(names)}"
                raise InputError(place=f"px {number}", expected=expected, found=found) from None
    if not rows:
        raise InputError("no laser (px)", place=path)
    enabled = [item.text for item in root.iterfind(".//enabled_/item")]
    used = enabled.count("1") or len(rows)  # the first lasers; others are of no unit
    up, aside, offsets, sideways = np.array(rows[:used]).T
    return _made(up, aside, path, offsets / 100, left_out=_sideways(sideways / 100))


def _hesai_csv(path: Path) -> MakerFile:
    """Read Hesai's angle correction: degrees, azimuths count clockwise."""
    table = read_csv(path, skipinitialspace=True)
    table.columns = table.columns.map(lambda name: str(name).strip().lower())
    if missing := [name for name in ("elevation", "azimuth") if name not in table]:
        names = ", ".join(table.columns)[:100]
        expected = "columns Channel, Elevation, Azimuth"
        raise InputError(f"no column {missing[0]}", place=path, expected=expected, found=names)
    up, aside = numbers(table, ["elevation", "azimuth"], str(path)).T
    return _made(up, -aside, path)


_READERS: dict[str, Callable[[Path], MakerFile]] = {
    ".json": _ouster,
    ".yaml": _velodyne_yaml,
    ".yml": _velodyne_yaml,
    ".xml": _velodyne_xml,
    ".csv": _hesai_csv,
}
