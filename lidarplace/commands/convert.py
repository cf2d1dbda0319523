"""Box logs from data sets and tables: `lidarplace convert --help`."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from lidarplace.base.ranges import LIDAR_HEIGHT, SHARE
from lidarplace.base.registry import PluginError
from lidarplace.command_line.option_groups import with_option_group
from lidarplace.command_line.terminal import say
from lidarplace.command_line.verbs import checked_input, known, new_app, verb, within, wrong
from lidarplace.commands.convert_options import DataSetOptions, RigOptions
from lidarplace.commands.convert_output import convert_log
from lidarplace.commands.convert_readers import READERS, Out, command_of_reader
from lidarplace.files.atomic import read_text
from lidarplace.logs.box_log import BoxLog
from lidarplace.scenes.datasets.argoverse import CLOUDS_ORIGIN, read_argoverse
from lidarplace.scenes.datasets.class_maps import PAPER, named_class_map
from lidarplace.scenes.datasets.nuscenes import ZOE, Vehicle, read_nuscenes
from lidarplace.scenes.datasets.openlabel import read_openlabel
from lidarplace.scenes.datasets.tabular import read_tabular
from lidarplace.scenes.datasets.truckscenes import TRUCK
from lidarplace.scenes.datasets.waymo import read_waymo
from lidarplace.scenes.kitti.calibration import LIDAR_HEIGHT_M
from lidarplace.scenes.kitti.read import read_kitti, subfolder
from lidarplace.scenes.label_tables.mapping import TableMapping, convention_keys, read_mapping
from lidarplace.scenes.label_tables.propose import propose_mapping
from lidarplace.scenes.label_tables.read import read_label_table
from lidarplace.scenes.label_tables.units import SECONDS
from lidarplace.scenes.sanity_checks.boxes import implausible_degrees
from lidarplace.scenes.sanity_checks.check_log import check_log, error_of, implausible_values


class _Readers(TyperGroup):
    """Group with a command for each of `READERS`."""

    def list_commands(self, ctx: Any) -> list[str]:
        return [*super().list_commands(ctx), *READERS.installed()]

    def get_command(self, ctx: Any, name: str) -> Any:
        if name in self.commands:
            return super().get_command(ctx, name)
        try:
            if name not in READERS.own and READERS.path(name) is None:
                return None
            command = command_of_reader(name)
        except PluginError as error:
            wrong(error)
        app_of_reader = new_app()
        verb(app_of_reader, f"data/{name} logs/{name}", name=name)(command)
        return typer.main.get_command(app_of_reader)


app = new_app(
    cls=_Readers,
    no_args_is_help=True,
    help="Write the box log of a data set or a table: the folder that a sweep takes as its scene.",
)


def _tables_command(vehicle: Vehicle, text: str, example: str) -> None:
    """Add the command of a data set of nuScenes' tables."""

    def convert(
        source: Annotated[Path, typer.Argument(help="folder v1.0-… of tables, or its parent")],
        out: Out,
        options: DataSetOptions,
        version: Annotated[str | None, typer.Option(help="such as v1.0-trainval")] = None,
        test_share: Annotated[
            float, typer.Option(help="share of the recordings for testing", callback=within(SHARE))
        ] = 0.2,
        test_scenes: Annotated[
            Path | None,
            typer.Option(help="text file with one test scene per line, instead of --test-share"),
        ] = None,
        channel: Annotated[
            list[str] | None,
            typer.Option(
                help="LiDAR of the rig, the one of the ego's poses first; repeatable, by default "
                "all"
            ),
        ] = None,
        origin: Annotated[
            tuple[float, float, float] | None,
            typer.Option(
                metavar="X Y Z",
                help="origin of the ego frame of the tables in ours, metres; by default that of "
                "the data set's vehicle",
            ),
        ] = None,
    ) -> None:
        def read(ignored: Counter[str]) -> BoxLog:
            test = read_text(test_scenes).split() if test_scenes else test_share
            arguments = options.arguments(ignored, several=True)
            if origin is not None:
                arguments["vehicle"] = replace(vehicle, origin=[0 - value for value in origin])
            return read_nuscenes(
                source,
                version=version,
                test_scenes=test,
                channels=channel or (),
                **{"vehicle": vehicle} | arguments,
            )

        convert_log(read, source, out, options)

    convert.__doc__ = text
    verb(app, f"data/{vehicle.name} logs/{vehicle.name} {example}", name=vehicle.name)(
        with_option_group()(convert)
    )


_tables_command(
    ZOE,
    "Annotated key frames of nuScenes v1.0, and data sets of the same tables.",
    "--version v1.0-mini",
)
_tables_command(
    TRUCK,
    "Annotated key frames of MAN TruckScenes, whose LiDARs have a model each.",
    "--lidar LIDAR_LEFT=pandar64,LIDAR_RIGHT=pandar64 --channel LIDAR_LEFT --channel LIDAR_RIGHT",
)


@verb(app, "data/av2/sensor logs/av2 --split val")
@with_option_group()
def argoverse(
    source: Annotated[Path, typer.Argument(help="folder that holds train and val")],
    out: Out,
    options: DataSetOptions,
    split: Annotated[
        list[str] | None, typer.Option(help="train, val or test; by default train and val")
    ] = None,
) -> None:
    """Argoverse 2 sensor data set; train stays train, val becomes test."""

    def read(ignored: Counter[str]) -> BoxLog:
        return read_argoverse(source, splits=split or (), **options.arguments(ignored))

    convert_log(read, source, out, options, CLOUDS_ORIGIN)


@verb(app, "data/waymo logs/waymo")
@with_option_group("clouds", "world")
def waymo(
    source: Annotated[Path, typer.Argument(help="folder that holds training and validation")],
    out: Out,
    options: DataSetOptions,
    split: Annotated[
        list[str] | None,
        typer.Option(help="training, validation or testing; by default the first two"),
    ] = None,
) -> None:
    """Waymo perception data set v2, tables of Parquet; validation becomes test."""

    def read(ignored: Counter[str]) -> BoxLog:
        return read_waymo(source, splits=split or (), **options.arguments(ignored))

    convert_log(read, source, out, options)


@verb(app, "data/openlabel logs/openlabel --origin -1.4 0 0.3 --test drive_2")
@with_option_group()
def openlabel(
    source: Annotated[Path, typer.Argument(help="a file, or a folder with one file per drive")],
    out: Out,
    origin: Annotated[
        tuple[float, float, float],
        typer.Option(
            metavar="X Y Z", help="origin of the file's vehicle frame in our ego frame, metres"
        ),
    ],
    options: RigOptions,
    vehicle: Annotated[
        str | None,
        typer.Option(help="the vehicle's coordinate system; by default the one of type local_cs"),
    ] = None,
    time_unit: Annotated[
        str, typer.Option(metavar="|".join(SECONDS), help="of time stamps that are numbers")
    ] = "s",
    test: Annotated[list[str] | None, typer.Option(help="name of a test drive; repeatable")] = None,
) -> None:
    """Cuboids of ASAM OpenLABEL 1.0."""

    def read(ignored: Counter[str]) -> BoxLog:
        units = {str(unit): value for unit, value in SECONDS.items()}
        return read_openlabel(
            source,
            origin=origin,
            vehicle=vehicle,
            seconds=known("time-unit", time_unit, units),
            test=test or (),
            class_map=named_class_map(options.class_map),
            ignored=ignored,
        )

    convert_log(read, source, out, options, origin)


@verb(
    app,
    "boxes.csv logs/boxes --frames 4000",
    "labels.csv --propose guess.yaml",
    "labels.csv --mapping map.yaml --preview first.html",
    "labels.csv logs/labels --mapping map.yaml",
)
@with_option_group()
def table(
    source: Annotated[
        Path, typer.Argument(help="table of boxes (.parquet, .csv), or folder of boxes and frames")
    ],
    options: RigOptions,
    out: Annotated[
        Path | None,
        typer.Argument(help="folder of the box log; not needed with --propose or --preview"),
    ] = None,
    frames: Annotated[
        str | None,
        typer.Option(help="table of all frames, or their number; empty frames count, too"),
    ] = None,
    mapping: Annotated[
        Path | None, typer.Option(help="YAML file that maps the columns of another table")
    ] = None,
    propose: Annotated[
        Path | None, typer.Option(help="write a proposed mapping to this file; never overwrites")
    ] = None,
    preview: Annotated[
        Path | None,
        typer.Option(
            help="write a page of the first frames from above, before anything else is written"
        ),
    ] = None,
) -> None:
    """Your own tables, with the columns of box logs, or with any others and a mapping.

    Columns: frame, class, x, y, z, length, width, height, yaw; metres and radians, ego frame. For
    other columns --propose writes a mapping to correct."""
    if propose is not None:
        others = (out, frames, mapping, preview, options.rig, options.clouds)
        if options.class_map != PAPER or any(other is not None for other in others):
            wrong("--propose only writes a mapping; remove OUT and other options")
        _propose(source, propose)
        return
    if mapping is not None and (frames is not None or options.class_map != PAPER):
        wrong("--mapping: defines frames and classes; remove --frames and --class-map")
    if out is None and preview is None:
        wrong("OUT: name the folder of the box log to write")
    with checked_input():
        columns = None if mapping is None else read_mapping(mapping)

    def read(ignored: Counter[str]) -> BoxLog:
        if columns is not None:
            candidates = columns.candidates()
            if preview is not None and len(candidates) > 1:
                logs = {
                    name: read_label_table(source, each, Counter())
                    for name, each in candidates.items()
                }
                _draw(logs, source, preview)
            return read_label_table(source, columns, ignored)
        number_or_table: int | Path | None = None
        if frames:
            number_or_table = int(frames) if frames.isdecimal() else Path(frames)
        classes = named_class_map(options.class_map)
        return read_tabular(source, frames=number_or_table, class_map=classes, ignored=ignored)

    def check(log: BoxLog) -> list[str]:
        if preview is not None:
            _draw({"": log}, source, preview)
        return _check(log, source, columns)

    origin = [0.0 if columns is None else getattr(columns.origin, axis) for axis in "xyz"]
    convert_log(read, source, out, options, origin, check=check)


@verb(app, "data/kitti logs/kitti --skip-bad")
@with_option_group()
def kitti(
    source: Annotated[Path, typer.Argument(help="folder of label_2 and calib, or its parent")],
    out: Out,
    options: DataSetOptions,
    standard_calibration: Annotated[
        bool, typer.Option(help="for frames without calib, use KITTI's usual camera")
    ] = False,
    lidar_height: Annotated[
        float,
        typer.Option(
            help="height of the LiDAR above the ground, metres", callback=within(LIDAR_HEIGHT)
        ),
    ] = LIDAR_HEIGHT_M,
    skip_bad: Annotated[
        bool, typer.Option("--skip-bad", help="skip invalid files, and list them")
    ] = False,
) -> None:
    """KITTI's object layout, as `export` writes it; labels are enough."""
    skipped: list[str] = []

    def read(ignored: Counter[str]) -> BoxLog:
        return read_kitti(
            source,
            standard_calibration=standard_calibration,
            lidar_height=lidar_height,
            skipped=skipped if skip_bad else None,
            **options.arguments(ignored),
        )

    store_clouds = options.clouds is not None
    with checked_input():
        velodyne = subfolder(source, "velodyne")
        if not store_clouds and velodyne.is_dir():
            options = replace(options, clouds=velodyne)
    convert_log(read, source, out, options, store_clouds=store_clouds)
    if skipped:
        say("\n".join([f"skipped {len(skipped)}:", *map(str, skipped)]))


def _propose(source: Path, path: Path) -> None:
    """Write a guess of the mapping of `source` to `path`, which must be free."""
    try:
        text = propose_mapping(source)
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        wrong(f"{path}: exists, and is not overwritten; name another file")
    except (ValueError, OSError) as error:
        wrong(error)
    say(path)


def _draw(logs: Mapping[str, BoxLog], source: Path, path: Path) -> None:
    from lidarplace.viewing.from_above import write_from_above

    write_from_above(path, logs, f"{source.name}: the first frames from above")
    say(path)


def _check(log: BoxLog, source: Path, mapping: TableMapping | None) -> list[str]:
    """Raise InputError for implausible values, and name the key of the mapping to change.

    Without a mapping, which may accept them, those that are not certain are warnings."""
    if mapping is None:
        return check_log(log, source, fix="change {remedy} of a mapping (--propose begins one)")
    of_degrees = implausible_degrees(log) if mapping.units.angle == "deg" else ()
    for value in chain(of_degrees, implausible_values(log)):
        if value.check not in mapping.accept:
            change = "change {remedy} of the mapping"
            if value.convention is not None and mapping.coordinates == "ego":
                convention = value.convention.after(mapping.of_boxes())
                keys = convention_keys(convention, mapping)
                change = f"write `{keys}` in the mapping".replace("{", "{{").replace("}", "}}")
            fix = f"{change}, or accept the value: accept: [{value.check}]"
            raise error_of(value, log, source, mapping.column(value.column), fix)
    return []
