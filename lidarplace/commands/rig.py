"""Rigs from and to the files of other tools: `lidarplace rig SOURCE OUT`."""

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from pydantic import ValidationError

from lidarplace.base.errors import InputError
from lidarplace.command_line.terminal import output, say, table
from lidarplace.command_line.verbs import checked_input, new_app, verb
from lidarplace.configuration.further_sensors import CameraSettings, RadarSettings
from lidarplace.configuration.sensor import SensorSettings
from lidarplace.configuration.settings import fault
from lidarplace.rig_files.autoware import FILES
from lidarplace.rig_files.formats import FORMATS, RigFormat, format_of
from lidarplace.rig_files.mounted import RigSensor, Vector, check_lidars, lidars_in, of_frame
from lidarplace.rig_files.mounts_yaml import read_mounts_yaml, write_mounts_yaml
from lidarplace.rigs.catalogue.datasheet import catalogue
from lidarplace.rigs.rotations import order_caution

app = new_app()

OWN = (".yaml", ".yml")
HEAD = ("sensor", "x", "y", "z", "roll", "pitch", "yaw", "beams")


@verb(
    app,
    "car.urdf rig.yaml --origin -1.4 0 0.3 --only '*lidar*'",
    "data/nuscenes/v1.0-mini rig.yaml --format nuscenes --lidar hdl32e --radar drvegrd171",
    "rig.yaml objects.json --format carla",
)
def rig(
    source: Annotated[Path, typer.Argument(help="rig to read")],
    out: Annotated[Path, typer.Argument(help="file to write; nuscenes: folder")],
    format_: Annotated[
        str | None,
        typer.Option(
            "--format",
            metavar="|".join(FORMATS),
            help="format of the file that is not YAML; detected for .urdf and .launch.xml",
            autocompletion=lambda: list(FORMATS),
        ),
    ] = None,
    origin: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="X Y Z",
            help="origin of that file's vehicle frame in our ego frame, metres; nuscenes and "
            "carla have a default",
        ),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PATTERN",
            help="sensors by name, * matches any text; repeatable. Required for LiDARs of urdf, "
            "ros2 and autoware, which have frames of all kinds; all by default in other formats",
        ),
    ] = None,
    cameras: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PATTERN", help="frames of urdf, ros2 and autoware that are cameras; repeatable"
        ),
    ] = None,
    radars: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PATTERN", help="frames of urdf, ros2 and autoware that are radars; repeatable"
        ),
    ] = None,
    lidar: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="model of the catalogue (`lidarplace sensors`) for LiDARs without one",
            autocompletion=lambda: list(catalogue()),
        ),
    ] = None,
    camera: Annotated[
        str | None, typer.Option(metavar="NAME", help="model of cameras without known angles")
    ] = None,
    radar: Annotated[
        str | None, typer.Option(metavar="NAME", help="model of radars without known angles")
    ] = None,
) -> None:
    """Read a rig from another tool's file, or write one; SOURCE or OUT is a YAML file of `mounts`.

    Prints the mounts in our ego frame: metres, degrees."""
    with checked_input():
        reads = _is_ours(out)
        if reads == _is_ours(source):
            expected = "exactly one YAML file with mounts"
            raise InputError(place=f"{source} and {out}", expected=expected)
        source.stat()  # raises if it is not there, before its frame is asked for
        format_of_file = format_of(source if reads else out, format_)
        start = _start(format_of_file, origin, source if reads else out)
        if (cameras or radars) and not (reads and format_of_file.frames):
            wrong = "are for frames that urdf, ros2 and autoware are read of"
            raise InputError(wrong, place="--cameras, --radars")
        if reads:
            sensors = format_of_file.read(source, only or [])
            for patterns, model in ((cameras, CameraSettings), (radars, RadarSettings)):
                frames = format_of_file.read(source, patterns) if patterns else []
                sensors += [of_frame(frame, model(z=0.0)) for frame in frames]
            sensors = [sensor.moved(*start) for sensor in sensors]
        else:
            sensors = read_mounts_yaml(source)
            if only:
                raise InputError("applies only when reading another tool's file", place="--only")
        check_lidars(sensors, str(source))
        sensors = _with_models(sensors, {"lidar": lidar, "camera": camera, "radar": radar})
        if reads:
            write_mounts_yaml(out, sensors)
        else:
            back = [-value for value in start]
            format_of_file.write(out, [sensor.moved(*back) for sensor in sensors])
    lidars = lidars_in(sensors)
    others = len(sensors) - len(lidars)
    if not reads and format_of_file.lidars_alone and others:
        say(f"left out, as {out} holds LiDARs alone: {others} others", sys.stderr)
    matrices = np.stack([each.mount.rotation for each in lidars])
    for caution in order_caution([each.name for each in lidars], matrices):
        say(f"warning: {caution}", sys.stderr)
    for sensor in sensors:
        if sensor.mount.z < 0:
            say(f"warning: {sensor.name} is {-sensor.mount.z:g} m under the ground", sys.stderr)
    output().print(table(None, HEAD, map(_row, sensors)))
    say(out)


def _is_ours(path: Path) -> bool:
    """Return whether a path is that of a YAML file of `mounts`."""
    return path.suffix in OWN and not path.name.endswith(FILES)


def _start(rig_format: RigFormat, origin: Vector | None, path: Path) -> Vector:
    start = rig_format.origin if origin is None else origin
    if start is None:
        ego = "our ego frame, which is on the ground under the centre"
        fix = f"set it in {ego}: --origin -1.4 0 0.3 for a rear axle"
        raise InputError("unknown origin of its vehicle frame", place=path, fix=fix)
    if not all(abs(value) <= 100 for value in start):
        values = " ".join(map(str, start))
        raise InputError(place="--origin", expected="numbers within 100 m", found=values)
    return start


def _with_models(sensors: Sequence[RigSensor], names: Mapping[str, str | None]) -> list[RigSensor]:
    """Give sensors models of the catalogue, by kind, where it is not known what they see."""
    with_models, kind = [], "lidar"
    try:
        model = None if names[kind] is None else SensorSettings(name=names[kind])
        for sensor in sensors:
            kind, further = str(sensor.kind), sensor.further
            if further is None:
                sensor = replace(sensor, model=sensor.model or model)
            elif names[kind] and further.built() is None:
                keys = further.model_dump(include=further.model_fields_set) | {"model": names[kind]}
                sensor = replace(sensor, further=type(further).model_validate(keys))
            with_models.append(sensor)
    except ValidationError as error:
        raise fault(error, f"--{kind}") from None
    return with_models


def _row(lidar: RigSensor) -> tuple[str, ...]:
    mount = lidar.mount
    angles = (math.degrees(angle) for angle in (mount.roll, mount.pitch, mount.yaw))
    numbers = (f"{value:z.6g}" for value in (mount.x, mount.y, mount.z, *angles))
    beams = "–" if lidar.model is None else str(lidar.model.lidar().beams)
    return (lidar.name, *numbers, beams if lidar.kind == "lidar" else lidar.kind)
