"""Output of a conversion: real points, rig and ground of a log, its folder and its tables."""

import shutil
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from lidarplace.base.class_names import counts_of
from lidarplace.base.errors import InputError, at
from lidarplace.clouds.clouds import read_clouds
from lidarplace.command_line.terminal import output, say, table
from lidarplace.command_line.verbs import checked_input, known
from lidarplace.logs.box_log import BoxLog, write_box_log
from lidarplace.logs.boxes import CLASSES, POINTS, points_of
from lidarplace.logs.world import CELL_M, TILE_M
from lidarplace.rig_files.mounted import check_lidars, lidars_in
from lidarplace.rig_files.own import read_own
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Placement
from lidarplace.rigs.recorded import RecordedRig
from lidarplace.rigs.rotations import order_caution
from lidarplace.scenes.ground_level import OFF, OFF_M, levelled, off_ground
from lidarplace.scenes.real_clouds import count_real_points
from lidarplace.scenes.sanity_checks.check_log import check_log
from lidarplace.scenes.static_world.world_builder import static_worlds

RECORDED = Path("clouds") / "recorded"
"""Of a log's folder: its real clouds, a folder each scene."""

KEEP, LEVEL = "keep", "level"


@dataclass(frozen=True)
class Real:
    """Options on the real vehicle and world.

    The static `world` is built of the clouds; if these are not `kept`, a wrong one is a warning.
    `rig` is the file of the rig of all scenes, `lidar` the model of mounts without one."""

    ground: str
    clouds: Path | None = None
    origin: Sequence[float] | None = None
    world: bool = False
    rig: Path | None = None
    lidar: str | None = None
    kept: bool = True


def model(name: str | None) -> Lidar | None:
    """Return the LiDAR of the catalogue that `--lidar` names; raise ValueError if there is none."""
    with at("--lidar"):
        return None if name is None else Lidar.named(name)


def _read_rig(path: Path | None, lidar: str | None) -> RecordedRig | None:
    """Read the rig in a file of mounts, with `lidar` where a mount has no model."""
    if path is None:
        if lidar is not None:
            raise InputError("is the model of a rig", place="--lidar", fix="name its file: --rig")
        return None
    mounted = lidars_in(read_own(path))
    check_lidars(mounted, str(path))
    models = []
    for each in mounted:
        own = model(lidar) if each.model is None else each.model.lidar()
        if own is None:
            fix = "name one with --lidar"
            raise InputError(f"{each.name} has no model", place=path, fix=fix)
        models.append(own)
    placement = Placement(path.stem, [each.mount for each in mounted], models)
    return RecordedRig(tuple(each.name for each in mounted), placement)


def convert_log(
    read: Callable[[Counter[str]], BoxLog],
    source: Path,
    out: Path | None,
    real: Real = Real(KEEP),
    check: Callable[[BoxLog, Path], list[str]] | None = None,
) -> None:
    """Read a log, write it to `out` if given, and print what is in it; a mistake ends with code 2.

    `check` returns warnings of implausible values, or raises InputError; by default `check_log`."""
    ignored: Counter[str] = Counter()
    notes: list[str] = []
    with checked_input():
        rig = _read_rig(real.rig, real.lidar)
        level = known("ground", real.ground, {KEEP: False, LEVEL: True})
        log = read(ignored)
        look = check or partial(check_log, fix="check {remedy} of the source")
        cautions = look(log, source)
        for recorded in {rig.names: rig for rig in log.rigs.values()}.values():
            matrices = np.stack([mount.rotation for mount in recorded.placement.mounts])
            cautions += order_caution(recorded.names, matrices)
        if rig is not None:
            log = replace(log, rigs=dict.fromkeys(log.frames["scene"].unique(), rig))
        if real.clouds is not None:
            log = _counted(log, real, out, notes)
        if real.world:
            log = _with_world(log, real, out, notes)
        tables = list(_tables(log, ignored))
        if level:
            log = _levelled(log, notes)
        if out is not None:
            if real.clouds is None or not real.kept:
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


def _counted(log: BoxLog, real: Real, out: Path | None, notes: list[str]) -> BoxLog:
    """Count the points of the log's clouds; an error is a warning where none are kept."""
    assert real.clouds is not None
    if real.kept and real.ground == LEVEL:
        wrong = "moves boxes away from the real points of --clouds"
        raise InputError(wrong, place="--ground level")
    keep = out / RECORDED if real.kept and out is not None else None
    try:
        log, number = count_real_points(log, real.clouds, real.origin, keep)
    except ValueError as error:
        if real.kept:
            raise
        say(f"warning: no points are counted: {error}", sys.stderr)
        return log
    notes.append(f"real clouds: {number:,} of {len(log.frames):,} frames have one")
    several = any(len(rig.names) > 1 for rig in log.rigs.values())
    if several and not log.boxes[list(points_of(log.boxes).values())].notna().any(axis=None):
        notes.append("points are not split by LiDAR: the clouds have no column lidar")
    return log


def _with_world(log: BoxLog, real: Real, out: Path | None, notes: list[str]) -> BoxLog:
    if real.clouds is None or not real.kept or out is None:
        fix = "name their folder: --clouds"
        raise InputError("is built of recorded clouds", place="--world", fix=fix)
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
    rows: list[Sequence[Any]] = [
        (split, own["scene"].nunique(), len(own), (~filled[own.index]).sum(), boxes.get(split, 0))
        for split, own in log.frames.groupby("split")
    ]
    yield _counts("Frames", ("split", "scenes", "frames", "empty frames", "boxes"), rows)
    counts = dict.fromkeys(CLASSES, 0) | counts_of(log.boxes["class"])
    counts |= {f"ignored: {name}": count for name, count in ignored.most_common()}
    yield _counts("Boxes", ("class", "boxes"), counts.items())
    if POINTS in log.boxes:
        columns = [("all", POINTS), *points_of(log.boxes).items()]
        found = ((name, log.boxes[column]) for name, column in columns)
        points = [(name, own.count(), round(own.sum())) for name, own in found]
        yield _counts("Real points", ("LiDAR", "boxes counted", "points"), points)
    ground = off_ground(log)
    if ground[list(OFF)].to_numpy().any():
        head = ("split", "boxes", "centre under", f"> {OFF_M:g} m below", f"> {OFF_M:g} m above")
        yield _counts("Boxes off the ground", head, ground.to_numpy())


def _counts(title: str, head: Sequence[str], rows: Iterable[Sequence[Any]]) -> Table:
    """Make a table of whole numbers but for the first column."""
    return table(title, head, ((row[0], *map("{:,}".format, row[1:])) for row in rows))
