"""What becomes of a log that was read: real points, rig and ground, its folder and its tables."""

from __future__ import annotations

import shutil
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
import typer
from rich.table import Table

from lidarplace.base.class_names import counts_of
from lidarplace.clouds.clouds import read_clouds
from lidarplace.command_line.terminal import output, say
from lidarplace.command_line.terminal import table as shown_table
from lidarplace.command_line.verbs import checked_input, known
from lidarplace.logs.box_log import BoxLog, write_box_log
from lidarplace.logs.boxes import CLASSES, POINTS, points_of
from lidarplace.logs.world import CELL_M, TILE_M
from lidarplace.rig_files.mounted import check_lidars
from lidarplace.rig_files.own import read_own
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Placement
from lidarplace.rigs.recorded import RecordedRig
from lidarplace.scenes.ground_level import OFF, OFF_M, levelled, off_ground
from lidarplace.scenes.real_clouds import RealClouds, count_real_points
from lidarplace.scenes.sanity_checks.boxes import doubts_of_units
from lidarplace.scenes.static_world import static_worlds

RECORDED = Path("clouds") / "recorded"
"""Of a log's folder: its real clouds, a folder each scene."""

KEEP, LEVEL = "keep", "level"

GroundOption = Annotated[
    str,
    typer.Option(
        "--ground",
        metavar=f"{KEEP}|{LEVEL}",
        help="keep: do not change heights of boxes; level: move boxes to the ground z = 0, by the "
        "median underside of nearby boxes in each frame",
    ),
]
CloudsOption = Annotated[
    Path | None,
    typer.Option(
        "--clouds",
        help="folder of the recorded clouds: count their points in boxes by LiDAR, and store "
        "them in OUT/clouds/recorded",
    ),
]
WorldOption = Annotated[
    bool,
    typer.Option(
        "--world",
        help="with --clouds: build the static world of unlabelled static objects, and the "
        "ground; simulated rays stop there",
    ),
]
RigOption = Annotated[
    Path | None,
    typer.Option(
        "--rig",
        help="YAML file of mounts with names and models: the rig that recorded the log; "
        "`lidarplace rig` converts files of other tools",
    ),
]
LidarOption = Annotated[
    str | None,
    typer.Option(
        "--lidar", help="LiDAR model of the recording, from `lidarplace sensors`, such as vlp16"
    ),
]


@dataclass(frozen=True)
class Real:
    """What is said of the real vehicle and world.

    Attributes:
        ground: `KEEP` or `LEVEL`.
        clouds: where real clouds are, or None.
        kept: whether they are kept; else a cloud that is wrong is a warning.
        rig: of all scenes, instead of those that the source has.
        world: whether the static world is built of the clouds.
    """

    ground: str = KEEP
    clouds: RealClouds | None = None
    kept: bool = True
    rig: RecordedRig | None = None
    world: bool = False


def clouds_in(folder: Path | None, origin: Sequence[float] | None = None) -> RealClouds | None:
    """The clouds that `--clouds` names."""
    return None if folder is None else RealClouds(folder, origin)


def model(name: str | None) -> Lidar | None:
    """The LiDAR of the catalogue that `--lidar` names. Raises ValueError if there is none."""
    return None if name is None else Lidar.named(name)


def read_rig(path: Path | None, lidar: str | None) -> RecordedRig | None:
    """The rig in a file of mounts, with `lidar` where a mount has no model.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is no such file, or the model is unknown.
    """
    if path is None:
        if lidar is not None:
            raise ValueError("--lidar: is the model of a rig; --rig names its file")
        return None
    mounted = read_own(path)
    check_lidars(mounted, str(path))
    models = []
    for each in mounted:
        own = model(lidar) if each.model is None else each.model.lidar()
        if own is None:
            raise ValueError(f"{path}: {each.name} has no model; --lidar names one")
        models.append(own)
    placement = Placement(path.stem, [each.mount for each in mounted], models)
    return RecordedRig(tuple(each.name for each in mounted), placement)


def convert_log(
    read: Callable[[Counter[str]], BoxLog],
    out: Path | None,
    check: Callable[[BoxLog], None] | None = None,
    real: Callable[[], Real] = Real,
) -> None:
    """Read a log, write it to `out` and say what is in it; a mistake ends with code 2.

    Implausible values give a warning, unless `check` looks at the log instead, which
    raises ValueError. Without `out` nothing is written.
    """
    ignored: Counter[str] = Counter()
    notes: list[str] = []
    with checked_input():
        told = real()
        level = known("ground", told.ground, {KEEP: False, LEVEL: True})
        log = read(ignored)
        if check is not None:
            check(log)
        else:
            for doubt in doubts_of_units(log):
                say(f"warning: {doubt.why}: {doubt.where(log.boxes)}", sys.stderr)
        if told.rig is not None:
            log = replace(log, rigs=dict.fromkeys(log.frames["scene"].unique(), told.rig))
        if told.clouds is not None:
            log = _counted(log, told, out, notes)
        if told.world:
            log = _with_world(log, told, out, notes)
        tables = [_frames_table(log), _boxes_table(log, ignored)]
        tables += [_points_table(log)] if POINTS in log.boxes else []
        ground = off_ground(log)
        tables += [_ground_table(ground)] if ground[list(OFF)].to_numpy().any() else []
        if level:
            log = _levelled(log, notes)
        if out is not None:
            if told.clouds is None or not told.kept:
                shutil.rmtree(out / RECORDED, ignore_errors=True)  # of a log of before
            write_box_log(out, log)
    notes += _rig_notes(log)
    output().print(*tables, sep="\n", soft_wrap=True)
    for note in notes:
        say(note)
    if out is not None:
        say(out)


def _counted(log: BoxLog, told: Real, out: Path | None, notes: list[str]) -> BoxLog:
    """The log with the points of its clouds; what is wrong is a warning where none are kept."""
    assert told.clouds is not None
    if told.kept and told.ground == LEVEL:
        raise ValueError("--ground level: moves boxes away from the real points of --clouds")
    keep = out / RECORDED if told.kept and out is not None else None
    try:
        log, number = count_real_points(log, told.clouds, keep)
    except ValueError as error:
        if told.kept:
            raise
        say(f"warning: no points are counted: {error}", sys.stderr)
        return log
    notes.append(f"real clouds: {number:,} of {len(log.frames):,} frames have one")
    several = any(len(rig.names) > 1 for rig in log.rigs.values())
    if several and not log.boxes[list(points_of(log.boxes).values())].notna().any(axis=None):
        notes.append("points are not split by LiDAR: the clouds have no column lidar")
    return log


def _with_world(log: BoxLog, told: Real, out: Path | None, notes: list[str]) -> BoxLog:
    if told.clouds is None or not told.kept or out is None:
        raise ValueError("--world: is built of recorded clouds; --clouds names their folder")
    folders = sorted((out / RECORDED).iterdir())
    log = replace(log, world=static_worlds(log, map(read_clouds, folders)))
    cells = sum(len(world.keys) for world in log.world.values())
    tiles = sum(len(world.tiles) for world in log.world.values())
    notes.append(
        f"static world: {cells:,} cells of {CELL_M:g} m, ground of "
        f"{tiles * TILE_M**2 / 1e4:,.1f} ha, in {len(log.world):,} scenes"
    )
    return log


def _levelled(log: BoxLog, notes: list[str]) -> BoxLog:
    level, moved = levelled(log)
    far = np.abs(moved)
    if len(far):
        off = [
            int(off_ground(each)[list(OFF)].sum()[["below", "above"]].sum())
            for each in (log, level)
        ]
        notes.append(
            f"--ground level: boxes moved by {np.median(far):.2f} m in the median, "
            f"{far.max():.2f} m at most; underside more than {OFF_M:g} m off the ground: "
            f"{off[0]:,} boxes before, {off[1]:,} after"
        )
    return level


def _rig_notes(log: BoxLog) -> list[str]:
    """Which rigs recorded the log; that none is known, where there are real points."""
    scenes = log.frames["scene"].nunique()
    rigs = Counter(rig.names for rig in log.rigs.values())
    notes = [
        f"rig: {', '.join(names)} ({number:,} of {scenes:,} scenes)"
        for names, number in rigs.items()
    ]
    if not rigs and POINTS in log.boxes:
        notes.append("rig: unknown, so these points are compared with no simulation")
    return notes


def _frames_table(log: BoxLog) -> Table:
    shown = shown_table("Frames", ("split", "scenes", "frames", "empty frames", "boxes"))
    filled = log.frames["frame"].isin(log.boxes["frame"])
    split_of_box = log.boxes["frame"].map(log.frames.set_index("frame")["split"])
    boxes = split_of_box.value_counts()
    for split, own in log.frames.groupby("split"):
        empty = (~filled[own.index]).sum()
        numbers = (own["scene"].nunique(), len(own), empty, boxes.get(split, 0))
        shown.add_row(str(split), *(f"{number:,}" for number in numbers))
    return shown


def _boxes_table(log: BoxLog, ignored: Counter[str]) -> Table:
    counts = dict.fromkeys(CLASSES, 0) | counts_of(log.boxes["class"])
    counts |= {f"ignored: {name}": count for name, count in ignored.most_common()}
    rows = ((name, f"{count:,}") for name, count in counts.items())
    return shown_table("Boxes", ("class", "boxes"), rows)


def _points_table(log: BoxLog) -> Table:
    columns = {"all": POINTS} | points_of(log.boxes)
    rows = (
        (name, f"{log.boxes[column].count():,}", f"{log.boxes[column].sum():,.0f}")
        for name, column in columns.items()
    )
    return shown_table("Real points", ("LiDAR", "boxes counted", "points"), rows)


def _ground_table(ground: pd.DataFrame) -> Table:
    head = ("split", "boxes", "centre under", f"> {OFF_M:g} m below", f"> {OFF_M:g} m above")
    rows = ((str(row[0]), *(f"{number:,}" for number in row[1:])) for row in ground.to_numpy())
    return shown_table("Boxes off the ground", head, rows)
