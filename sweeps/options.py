"""Arguments and options that commands on a sweep's file share."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from lidarplace.command_line.invocation import command
from lidarplace.command_line.verbs import wrong


def _key_paths(incomplete: str) -> Iterator[str]:
    """Return keys of sweeps and searches for a shell to complete, one level at a time."""
    from sweeps.configuration.search import SearchFile
    from sweeps.configuration.sweep import SweepFile

    sweep, search = (file.model_json_schema() for file in (SweepFile, SearchFile))
    place, kinds = sweep["properties"] | search["properties"], sweep["$defs"] | search["$defs"]
    *parents, _ = incomplete.split(".")
    for key in parents:
        named = place.get(key, {})
        options = [named, *named.get("anyOf", ()), *named.get("oneOf", ())]
        names = [option["$ref"].rpartition("/")[2] for option in options if "$ref" in option]
        # A scene has one of several kinds.
        fields = [kinds[name].get("properties", {}) for name in names]
        place = {key: field for properties in fields for key, field in properties.items()}
    yield from (".".join([*parents, key]) for key in place)


def _check_pairs(value: list[str] | None) -> list[str] | None:
    """Reject `--set key value` before the value is taken for an argument too many."""
    from sweeps.configuration.file import ConfigError, split_override

    for pair in value or ():
        try:
            split_override(pair)
        except ConfigError as error:
            wrong(error)
    return value


def given(config: Path | None, kind: str, example: str, json_alone: bool) -> Path:
    """Return the file of a `run` or a `search`; exits where `--json` has nothing to show."""
    if config is None:
        wrong(f"missing configuration file, such as {example}")
    if json_alone:
        status_line = command("status", str(config), "--json")
        wrong(f"--json: needs --dry-run or --schema; for the progress of a {kind}: {status_line}")
    return config


SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="override a key path",
        autocompletion=_key_paths,
        callback=_check_pairs,
    ),
]

DryRunOption = Annotated[bool, typer.Option("--dry-run", help="print the plan and exit")]

SchemaOption = Annotated[bool, typer.Option("--schema", help="print the JSON schema of the file")]

RigsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--rig",
        metavar="NAME=PATH",
        help="detections of a rig, a file or a folder; repeatable; the same name again is another "
        "training of its detector",
    ),
]
GeometryOption = Annotated[
    list[str] | None,
    typer.Option(
        "--geometry",
        metavar="NAME=WHAT",
        help="where the LiDARs of a rig are: recorded, for the rig that recorded the log; "
        "LIDAR+LIDAR, for some of it; or FILE.yaml; repeatable",
    ),
]
LayoutOption = Annotated[
    str | None,
    typer.Option(
        metavar="kitti|nuscenes|argoverse|waymo|parquet", help="by default from the file names"
    ),
]
WorldFrameOption = Annotated[
    bool, typer.Option("--world", help="boxes of plain Parquet are in the world, not the ego frame")
]
CalibOption = Annotated[
    Path | None,
    typer.Option(
        "--calib", help="folder of KITTI's calib files; the camera of `export` if not given"
    ),
]
DetectionClassMapOption = Annotated[
    str,
    typer.Option(
        "--class-map", metavar="paper|own|FILE", help="the one with which `convert` made the log"
    ),
]
ClassesOption = Annotated[
    list[str] | None,
    typer.Option("--class", metavar="NAME", help="repeatable; all classes of the log by default"),
]
SplitOption = Annotated[str, typer.Option(metavar="train|test", help="frames to evaluate")]
AcceptOption = Annotated[
    list[str] | None,
    typer.Option("--accept", metavar="CHECK", help="a check of detections to skip; repeatable"),
]
CountedOption = Annotated[
    str,
    typer.Option(
        metavar="visible|points",
        help="objects of the ROI that count: visible to an ideal sensor on the roof, as in a "
        "sweep; or with a recorded point, if the log has them",
    ),
]
"""Of commands that read detections from elsewhere."""
