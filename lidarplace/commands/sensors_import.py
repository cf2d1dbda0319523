"""A LiDAR of the file of its maker: `lidarplace sensors import FILE`."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
import yaml

from lidarplace.command_line.terminal import output, say, table
from lidarplace.command_line.verbs import checked_input
from lidarplace.commands.sensors_fit import ends
from lidarplace.configuration.sensor import SensorSettings
from lidarplace.configuration.settings import validated
from lidarplace.files.atomic import write_text
from lidarplace.rig_files.maker_files import MakerFile, read_maker_file
from lidarplace.rig_files.mounts_yaml import as_written
from lidarplace.rigs.catalogue.datasheet import FRAMES_PER_S, Datasheet, catalogue, datasheet

ALIKE_DEGREES = 1.0  # beams of the nearest entry differ by less in the median, or it is another one
DIGITS = 3
TEXT_WIDTH = 100


def import_(
    file: Annotated[
        Path,
        typer.Argument(
            help="Ouster's metadata (.json), Velodyne's calibration (.yaml, .xml) or Hesai's angle "
            "correction (.csv)"
        ),
    ],
    out: Annotated[
        Path | None, typer.Option(help="write the `lidar:` block to this file, not to the terminal")
    ] = None,
    like: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="entry of the catalogue for what the file does not say; by default the one with "
            "the nearest beams",
            autocompletion=lambda: list(catalogue()),
        ),
    ] = None,
) -> None:
    """Read a LiDAR from its maker's file, and compare it with the nearest one of the catalogue."""
    with checked_input():
        lidar = read_maker_file(file)
        sheet = nearest(lidar) if like is None else datasheet(like)
        entry = sheet if like is not None or _apart(lidar, sheet) < ALIKE_DEGREES else None
        model = validated(SensorSettings, _keys(lidar, entry), str(file))
        content = {"lidar": as_written(model)}
        text = yaml.safe_dump(
            content, sort_keys=False, default_flow_style=None, width=TEXT_WIDTH
        ).rstrip()
        if out is not None:
            write_text(out, f"{text}\n")
    output().print(table(None, (file.name, "file", sheet.name), _rows(lidar, sheet)))
    for part in lidar.left_out:
        say(f"left out: {part}")
    if entry is None:
        missing = "range" if lidar.azimuth_steps else "range and azimuth_steps"
        say(f"{sheet.name} is the nearest of the catalogue, but another LiDAR: add {missing}")
    if lidar.azimuth_steps is None and entry is not None:
        say(f"azimuth steps and ranges are those of {sheet.name}")
    say(out if out is not None else text)


def nearest(lidar: MakerFile) -> Datasheet:
    """Return the entry whose beams differ least, those with as many beams first."""
    sheets = [sheet for sheet in catalogue().values() if sheet.elevations_deg]
    beams = len(lidar.elevations_deg)
    return min(
        sheets, key=lambda sheet: (abs(len(sheet.elevations_deg) - beams), _apart(lidar, sheet))
    )


def _apart(lidar: MakerFile, sheet: Datasheet) -> float:
    """Return the median difference of elevations, degrees; infinite for other numbers of beams."""
    if len(sheet.elevations_deg) != len(lidar.elevations_deg):
        return np.inf
    return float(np.median(np.abs(lidar.elevations_deg - np.array(sheet.elevations_deg))))


def _keys(lidar: MakerFile, sheet: Datasheet | None) -> dict[str, Any]:
    keys: dict[str, Any] = {} if sheet is None else {"name": sheet.name}
    keys["elevations_deg"] = lidar.elevations_deg.round(DIGITS).tolist()
    if np.ptp(lidar.azimuth_offsets_deg) or lidar.azimuth_offsets_deg.any():
        keys["azimuth_offsets_deg"] = lidar.azimuth_offsets_deg.round(DIGITS).tolist()
    if lidar.offsets_m is not None:
        keys["offsets_m"] = lidar.offsets_m.round(DIGITS + 1).tolist()
    for name in ("azimuth_steps", "azimuth_deg"):
        if (value := getattr(lidar, name)) is not None:
            keys[name] = value
    return keys


def _rows(lidar: MakerFile, sheet: Datasheet) -> Iterator[tuple[str, str, str]]:
    stated = np.array(sheet.elevations_deg)
    yield "model", lidar.model or "–", f"{sheet.maker} {sheet.model}"
    yield "beams", str(len(lidar.elevations_deg)), str(len(stated))
    yield "elevation, degrees", ends(lidar.elevations_deg), ends(stated)
    if len(stated) == len(lidar.elevations_deg):
        differences = np.abs(lidar.elevations_deg - stated)
        yield (
            "difference, degrees",
            f"{np.median(differences):.3f}, at most {differences.max():.3f}",
            "",
        )
    yield "azimuth offsets, degrees", ends(lidar.azimuth_offsets_deg), "–"
    offsets, of_sheet = lidar.offsets_m, sheet.offsets_m
    yield (
        "laser offsets, m",
        "–" if offsets is None else ends(offsets),
        "–" if of_sheet is None else ends(np.array(of_sheet)),
    )
    steps = "–" if lidar.azimuth_steps is None else f"{lidar.azimuth_steps:,}"
    yield "azimuth steps", steps, f"{sheet.azimuth_steps:,}"
    yield "rate, Hz", "–" if lidar.rate_hz is None else f"{lidar.rate_hz:g}", str(FRAMES_PER_S)
    yield "range, m", "–", f"{sheet.range:g}"
