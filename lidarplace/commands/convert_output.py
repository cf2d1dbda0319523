"""Output of a conversion: real points, rig and ground of a log, its folder and its tables."""

import shutil
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from lidarplace.base.class_names import counts_of
from lidarplace.base.errors import InputError
from lidarplace.clouds.clouds import read_clouds
from lidarplace.command_line.terminal import output, say, table
from lidarplace.command_line.verbs import checked_input, known
from lidarplace.commands.convert_options import KEEP, LEVEL, LogOptions
from lidarplace.logs.box_log import BoxLog, write_box_log
from lidarplace.logs.boxes import CLASSES, POINTS, points_of
from lidarplace.logs.world import CELL_M, TILE_M
from lidarplace.rigs.rotations import order_caution
from lidarplace.scenes.ground_level import OFF, OFF_M, levelled, off_ground
from lidarplace.scenes.real_clouds import count_real_points
from lidarplace.scenes.sanity_checks.check_log import check_log
from lidarplace.scenes.static_world.world_builder import static_worlds

RECORDED = Path("clouds") / "recorded"
"""Folder in a log's folder of its real clouds, a folder each scene."""


def convert_log(
    read: Callable[[Counter[str]], BoxLog],
    source: Path,
    out: Path | None,
    options: LogOptions = LogOptions(),
    origin: Sequence[float] | None = None,
    check: Callable[[BoxLog], list[str]] | None = None,
    store_clouds: bool = True,
) -> None:
    """Read a log, write it to `out` if given, and print what is in it.

    `read` counts the boxes left out by category. `origin` is that of the clouds, see
    `count_real_points`; if they are not stored, invalid ones are a warning. `check` returns
    warnings of implausible values, or raises InputError; None: `check_log`. An error of the input
    ends the program with exit code 2."""
    ignored: Counter[str] = Counter()
    notes: list[str] = []
    with checked_input():
        rig = options.recorded_rig()
        level = known("ground", options.ground, {KEEP: False, LEVEL: True})
        log = read(ignored)
        fix = "check {remedy} of the source"
        cautions = check_log(log, source, fix=fix) if check is None else check(log)
        for recorded in {rig.names: rig for rig in log.rigs.values()}.values():
            matrices = np.stack([mount.rotation for mount in recorded.placement.mounts])
            cautions += order_caution(recorded.names, matrices)
        if rig is not None:
            log = replace(log, rigs=dict.fromkeys(log.frames["scene"].unique(), rig))
        stored = out / RECORDED if store_clouds and options.clouds and out is not None else None
        if options.clouds is not None:
            if store_clouds and level:
                wrong = "moves boxes away from the real points of --clouds"
                raise InputError(wrong, place="--ground level")
            log = _count_points(log, options.clouds, origin, stored, store_clouds, notes)
        if options.world:
            log = _with_world(log, stored, notes)
        tables = list(_tables(log, ignored))
        if level:
            log = _levelled(log, notes)
        if out is not None:
            if stored is None:
                shutil.rmtree(out / RECORDED, ignore_errors=True)  # of a log of before
            write_box_log(out, log)
    for caution in cautions:
        say(f"warning: {caution}", sys.stderr)
    notes += _rig_notes(log)
    if not (log.frames["split"] == "test").any():
        notes.append("no test frames: sweeps with detectors need some")
    output().print(*tables, sep="\n", soft_wrap=True)
    for note in notes:
        say(note)
    if out is not None:
        say(out)


def _count_points(
    log: BoxLog,
    clouds: Path,
    origin: Sequence[float] | None,
    stored: Path | None,
    strict: bool,
    notes: list[str],
) -> BoxLog:
    """Count the points of the log's clouds; unless `strict`, an error is a warning."""
    try:
        log, number = count_real_points(log, clouds, origin, stored)
    except ValueError as error:
        if strict:
            raise
        say(f"warning: no points are counted: {error}", sys.stderr)
        return log
    notes.append(f"real clouds: {number:,} of {len(log.frames):,} frames have one")
    several = any(len(rig.names) > 1 for rig in log.rigs.values())
    if several and not log.boxes[list(points_of(log.boxes).values())].notna().any(axis=None):
        notes.append("points are not split by LiDAR: the clouds have no column lidar")
    return log


def _with_world(log: BoxLog, clouds: Path | None, notes: list[str]) -> BoxLog:
    if clouds is None:
        fix = "name their folder: --clouds"
        raise InputError("is built of recorded clouds", place="--world", fix=fix)
    log = replace(log, world=static_worlds(log, map(read_clouds, sorted(clouds.iterdir()))))
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
        before, after = (
            int(off_ground(each)[["below", "above"]].to_numpy().sum()) for each in (log, level)
        )
        notes.append(
            f"--ground level: boxes moved by {np.median(far):.2f} m in the median, "
            f"{far.max():.2f} m at most; underside more than {OFF_M:g} m off the ground: "
            f"{before:,} boxes before, {after:,} after"
        )
    return level


def _rig_notes(log: BoxLog) -> list[str]:
    """Note which rigs recorded the log, or that none is known, where there are real points."""
    scenes = log.frames["scene"].nunique()
    rigs = Counter(", ".join(rig.names) for rig in log.rigs.values())
    if not rigs and POINTS in log.boxes:
        return ["rig: unknown, so these points are compared with no simulation"]
    return [f"rig: {names} ({number:,} of {scenes:,} scenes)" for names, number in rigs.items()]


def _tables(log: BoxLog, ignored: Counter[str]) -> Iterator[Table]:
    """Yield frames, boxes and, if there are any, real points and boxes off the ground."""
    filled = log.frames["frame"].isin(log.boxes["frame"])
    split_of_box = log.boxes["frame"].map(log.frames.set_index("frame")["split"])
    boxes = split_of_box.value_counts()
    rows: list[Sequence[Any]] = []
    for split, frames in log.frames.groupby("split"):
        empty = (~filled[frames.index]).sum()
        rows.append((split, frames["scene"].nunique(), len(frames), empty, boxes.get(split, 0)))
    yield _counts("Frames", ("split", "scenes", "frames", "empty frames", "boxes"), rows)
    counts = dict.fromkeys(CLASSES, 0) | counts_of(log.boxes["class"])
    counts |= {f"ignored: {name}": count for name, count in ignored.most_common()}
    yield _counts("Boxes", ("class", "boxes"), counts.items())
    if POINTS in log.boxes:
        columns = [("all", POINTS), *points_of(log.boxes).items()]
        points = [(n, log.boxes[c].count(), round(log.boxes[c].sum())) for n, c in columns]
        yield _counts("Real points", ("LiDAR", "boxes counted", "points"), points)
    ground = off_ground(log)
    if ground[list(OFF)].to_numpy().any():
        head = ("split", "boxes", "centre under", f"> {OFF_M:g} m below", f"> {OFF_M:g} m above")
        yield _counts("Boxes off the ground", head, ground.to_numpy())


def _counts(title: str, head: Sequence[str], rows: Iterable[Sequence[Any]]) -> Table:
    return table(title, head, ((row[0], *map("{:,}".format, row[1:])) for row in rows))
