"""Fit of a LiDAR's model to its own clouds: `lidarplace sensors fit CLOUDS`."""

import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
import typer
import yaml

from lidarplace.base.errors import InputError
from lidarplace.clouds.cloud_files import CLOUD_SUFFIXES, read_cloud
from lidarplace.clouds.scan_fit import ScanFit, fit_scan
from lidarplace.command_line.terminal import output, say, table
from lidarplace.command_line.verbs import checked_input
from lidarplace.configuration.sensor import SensorSettings
from lidarplace.files.atomic import write_text
from lidarplace.files.regular import files_in
from lidarplace.logs.box_log import read_box_log
from lidarplace.rig_files.mounted import RigSensor, lidars_in
from lidarplace.rig_files.mounts_yaml import as_written, read_mounts_yaml, write_mounts_yaml
from lidarplace.rigs.catalogue.datasheet import FRAMES_PER_S, Datasheet, catalogue, datasheet
from lidarplace.rigs.placement import Mount

MOST_CLOUDS = 10
"""Clouds of a folder that are fitted: more sweeps add little."""
OTHER_RATE = 0.1
"""Share of the catalogue's steps by which a LiDAR that turns at another rate differs."""

Pose = tuple[float, float, float, float, float, float]


def fit(
    clouds: Annotated[
        list[Path],
        typer.Argument(help="files of one sweep each, or folders of them", metavar="CLOUDS..."),
    ],
    like: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="of the catalogue: gives what clouds do not show; by default the nearest is shown",
            autocompletion=lambda: list(catalogue()),
        ),
    ] = None,
    rig: Annotated[
        Path | None,
        typer.Option(
            help="for clouds in the ego frame: YAML file of the mounts, or a log with its rig"
        ),
    ] = None,
    mount: Annotated[
        Pose | None,
        typer.Option(help="the same for one LiDAR: x y z roll pitch yaw, metres and degrees"),
    ] = None,
    origin: Annotated[
        tuple[float, float, float],
        typer.Option(help="with --rig: origin of the clouds' ego frame in ours, x y z in metres"),
    ] = (0.0, 0.0, 0.0),
    out: Annotated[
        Path | None, typer.Option(help="YAML file to write: `lidar`, or `mounts` of a rig")
    ] = None,
) -> None:
    """Fit elevations, laser offsets, azimuth steps and range noise to clouds of a LiDAR.

    Clouds have a column ring, or KITTI's order. They are in the frame of their LiDAR, or in that of
    the vehicle, with --rig or --mount."""
    with checked_input():
        sheet = None if like is None else datasheet(like)
        if sheet is not None and sheet.rosette is not None:
            raise InputError(f"{sheet.name} has no beams that turn", place="--like")
        fits = {}
        for lidar, sweeps in _by_lidar(_files(clouds), _lidars(rig, mount, origin)).items():
            fits[lidar] = fit_scan(sweeps)
            if sheet is not None:
                _check_rings(fits[lidar], sheet, next(iter(sweeps)))
        if out is not None:
            models = {lidar: _model(scan, sheet) for lidar, scan in fits.items()}
            _write(out, models, rig or mount)
    for lidar, scan in fits.items():
        _show(lidar.name, scan, sheet or _nearest(scan))
    if out is not None:
        say(out)


def _files(clouds: Sequence[Path]) -> list[Path]:
    files: list[Path] = []
    for path in clouds:
        inside = [path]
        if path.is_dir():
            inside = [file for file in files_in(path) if file.name.endswith(CLOUD_SUFFIXES)]
        if not inside:
            expected = f"files of {', '.join(CLOUD_SUFFIXES)}"
            raise InputError("no clouds", place=path, expected=expected)
        files += inside
    if len(files) > MOST_CLOUDS:
        say(f"fitted to {MOST_CLOUDS} of {len(files)} clouds, evenly spread", sys.stderr)
        files = [files[n * len(files) // MOST_CLOUDS] for n in range(MOST_CLOUDS)]
    return files


def _lidars(
    rig: Path | None, mount: Pose | None, origin: tuple[float, float, float]
) -> list[RigSensor]:
    """Return the LiDARs of the vehicle in the frame of its clouds, none for the sensor's frame."""
    if rig is not None and mount is not None:
        raise InputError("names the mounts already", place="--rig", fix="leave --mount out")
    if mount is not None:
        return [RigSensor("lidar", Mount.degrees(*mount))]
    if rig is None:
        return []
    if rig.is_dir():
        rigs = list(read_box_log(rig).rigs.values())
        if not rigs or any(other != rigs[0] for other in rigs):
            problem = "scenes have different rigs" if rigs else "log has no recorded rig"
            raise InputError(problem, place=f"--rig {rig}", fix="name a pose with --mount")
        mounts = zip(rigs[0].names, rigs[0].placement.mounts, strict=True)
        lidars = [RigSensor(*named_mount) for named_mount in mounts]
    else:
        lidars = lidars_in(read_mounts_yaml(rig))
    return [lidar.moved(*(-value for value in origin)) for lidar in lidars]


def _by_lidar(
    files: Sequence[Path], lidars: Sequence[RigSensor]
) -> dict[RigSensor, dict[str, pd.DataFrame]]:
    """Read the sweeps of each LiDAR in its own frame, by their files."""
    sweeps: dict[RigSensor, dict[str, pd.DataFrame]] = {}
    for path in files:
        cloud = read_cloud(path)
        parts = cloud.groupby("lidar") if "lidar" in cloud else [(None, cloud)]
        for number, part in parts:
            lidar = _lidar(number, lidars, path)
            mount = lidar.mount
            points = (part[["x", "y", "z"]].to_numpy(np.float64) - mount.position) @ mount.rotation
            name = str(path) if number is None else f"{path}: {lidar.name}"
            sweep = part.assign(**dict(zip("xyz", points.T, strict=True)))
            sweeps.setdefault(lidar, {})[name] = sweep
    if len(sweeps) > 1 and not lidars:
        wrong, fix = f"{len(sweeps)} LiDARs in one cloud", "name their poses: --rig"
        raise InputError(wrong, place=files[0], fix=fix)
    return sweeps


def _lidar(number: Any, lidars: Sequence[RigSensor], path: Path) -> RigSensor:
    """Find the LiDAR of a value of column lidar, a name or a number in the order of the rig."""
    if not lidars:
        return RigSensor("lidar" if number is None else str(number), Mount())
    if number is None and len(lidars) == 1:
        return lidars[0]
    by_name: Mapping[Any, RigSensor] = {lidar.name: lidar for lidar in lidars}
    by_number = dict(enumerate(lidars))
    if number not in by_name and number not in by_number:
        wrong = "no column lidar" if number is None else f"unknown LiDAR {number}"
        allowed = f"one of {', '.join(by_name)}, or their numbers from 0"
        raise InputError(wrong, place=path, expected=allowed)
    return by_name[number] if number in by_name else by_number[number]


def _check_rings(scan: ScanFit, sheet: Datasheet, place: str) -> None:
    last, most = len(sheet.elevations_deg) - 1, max(*scan.rings, *scan.left_out)
    if most > last:
        problem = f"rings beyond the beams of {sheet.name}"
        raise InputError(problem, place=place, expected=f"0 to {last}", found=most)


def _nearest(scan: ScanFit) -> Datasheet | None:
    same = [s for s in catalogue().values() if len(s.elevations_deg) == len(scan.elevations)]
    return min(same, key=lambda sheet: float(np.median(_apart(scan, sheet))), default=None)


def _apart(scan: ScanFit, sheet: Datasheet) -> Any:
    """Return differences of elevations, degrees: beam by beam, or from the nearest beam."""
    fitted, stated = np.degrees(scan.elevations), np.array(sheet.elevations_deg)
    if len(fitted) == len(stated):
        return np.abs(fitted - stated)
    return np.abs(fitted[:, None] - stated).min(axis=1)


def _model(scan: ScanFit, sheet: Datasheet | None) -> SensorSettings:
    keys: dict[str, Any] = {
        "elevations_deg": [round(math.degrees(e), 3) for e in scan.elevations],
        "offsets_m": scan.offsets,
        "azimuth_steps": scan.azimuth_steps,
    }
    keys |= {"range": float(math.ceil(scan.range))} if sheet is None else {"name": sheet.name}
    if scan.range_noise is not None:
        keys["range_noise"] = round(scan.range_noise, 4)
    return SensorSettings.model_validate(keys)


def _write(out: Path, models: Mapping[RigSensor, SensorSettings], posed: object) -> None:
    if posed:
        write_mounts_yaml(
            out, [RigSensor(at.name, at.mount, model) for at, model in models.items()]
        )
        return
    (model,) = models.values()
    content = {"lidar": as_written(model)}
    write_text(out, yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=100))


def _show(name: str, scan: ScanFit, sheet: Datasheet | None) -> None:
    head = (name, "fitted", "–" if sheet is None else sheet.name)
    output().print(table(None, head, _rows(scan, sheet)))
    if sheet is not None:
        apart = _apart(scan, sheet)
        say(
            f"elevations differ from those of {sheet.name} by {np.median(apart):.3f} degrees in "
            f"the median, {apart.max():.3f} at most"
        )
        ratio = scan.azimuth_steps / sheet.azimuth_steps
        rate = FRAMES_PER_S / ratio
        if abs(ratio - 1) > OTHER_RATE:
            say(
                f"warning: {scan.azimuth_steps:,} azimuth steps are {ratio:.2f} of those of "
                f"{sheet.name} at {FRAMES_PER_S} Hz: it turns at about {rate:.1f} Hz, as "
                f"{sheet.name}@{rate:.0f}hz does",
                sys.stderr,
            )
    if scan.left_out:
        rings = ", ".join(map(str, scan.left_out))
        say(f"warning: rings with too few points are left out: {rings}", sys.stderr)


def _rows(scan: ScanFit, sheet: Datasheet | None) -> Iterator[tuple[str, str, str]]:
    degrees = np.degrees(scan.elevations)
    stated = None if sheet is None else np.array(sheet.elevations_deg)
    rate = "–" if scan.rate is None else f"{scan.rate:.1f}"
    yield "beams", str(len(degrees)), "" if stated is None else str(len(stated))
    yield "elevation, degrees", ends(degrees), "" if stated is None else ends(stated)
    yield "laser offsets, m", _blocks(scan.offsets), _blocks(sheet.offsets_m if sheet else None)
    yield "rays start at, m", " ".join(f"{value:.2f}" for value in scan.origin), ""
    yield "azimuth steps", f"{scan.azimuth_steps:,}", f"{sheet.azimuth_steps:,}" if sheet else ""
    yield "rate, Hz", rate, str(FRAMES_PER_S) if sheet else ""
    yield "range noise, m", _number(scan.range_noise), _number(sheet.range_noise if sheet else None)
    yield "range, m", f"{scan.range:.0f}", f"{sheet.range:g}" if sheet else ""
    yield "returns, %", f"{100 * scan.share:.0f}", ""


def ends(values: Any) -> str:
    """Write the least and the greatest of several values."""
    return f"{values.min():.2f} to {values.max():.2f}"


def _blocks(offsets: Sequence[float] | None) -> str:
    return "–" if offsets is None else ", ".join(f"{offset:g}" for offset in dict.fromkeys(offsets))


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"
