"""A box log as a whole: its tables, and the folder that holds them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd
from pydantic import TypeAdapter, ValidationError

from lidarplace.base.errors import InputError
from lidarplace.base.number_text import percent
from lidarplace.files import columns
from lidarplace.files.atomic import replacing
from lidarplace.files.json_file import read_json
from lidarplace.files.regular import is_there
from lidarplace.files.tables import read_parquet
from lidarplace.logs.boxes import (
    BOX_COLUMNS,
    BUILDING_COLUMNS,
    FRAME_COLUMNS,
    FULL_POSE_COLUMNS,
    GEOMETRY,
    POSE_COLUMNS,
    SIZE,
    SOURCE,
    SPLITS,
    VIEWPOINT_Z,
    check_boxes,
    check_classes,
    count_columns,
    first,
    points_of,
)
from lidarplace.logs.world import StaticWorld, read_worlds, write_worlds
from lidarplace.rigs.recorded import RecordedRig

RIG_FILE = "rig.json"
WORLD_FILE = "world.npz"
UNIQUE = "a number of its own in the whole log, whatever the scene"  # what a frame has
_RIGS = TypeAdapter(dict[str, RecordedRig])


def _no_buildings() -> pd.DataFrame:
    types = {"scene": str} | dict.fromkeys(GEOMETRY, float)
    return pd.DataFrame(columns=[*BUILDING_COLUMNS]).astype(types)


@dataclass(frozen=True)
class BoxLog:
    """Boxes around the vehicle in every frame.

    Attributes:
        boxes: one row a box, columns `BOX_COLUMNS`, ego frame. A source that counts the real
            points in a box adds `POINTS`, and `points/NAME` for each LiDAR.
        frames: one row a frame, columns `FRAME_COLUMNS`; frames without boxes too. A source that
            knows where the vehicle was adds `POSE_COLUMNS`, and maybe `FULL_POSE_COLUMNS`; one
            that names its frames adds `SOURCE`; a site adds `VIEWPOINT_Z`.
        buildings: what stands still and is no object: columns `BUILDING_COLUMNS`, in the world
            frame of its scene, in which `POSE_COLUMNS` place the vehicle. Mostly empty.
        rigs: the rig that recorded each scene, by the scene's name, where known; plain data of
            it, as JSON holds it, is taken too.
        world: what stands still and the ground, of each scene of which recorded clouds show it, by
            the scene's name, in the same frame as buildings.

    Raises ValueError for an invalid rig."""

    boxes: pd.DataFrame
    frames: pd.DataFrame
    buildings: pd.DataFrame = field(default_factory=_no_buildings)
    rigs: Mapping[str, RecordedRig] = field(default_factory=dict)
    world: Mapping[str, StaticWorld] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "rigs", _RIGS.validate_python(self.rigs))

    def __repr__(self) -> str:
        splits = self.frames["split"].value_counts()
        counts = self.boxes["class"].value_counts()
        of = ", ".join(f"{count:,} {split}" for split, count in splits.items())
        boxes = ", ".join(f"{name} {count:,}" for name, count in counts.items())
        text = f"{len(self.frames):,} frames ({of}), {len(self.boxes):,} boxes ({boxes})"
        text += f", {len(self.buildings):,} buildings" if len(self.buildings) else ""
        text += f", rigs of {len(self.rigs):,} scenes" if self.rigs else ""
        text += f", static world of {len(self.world):,} scenes" if self.world else ""
        return f"BoxLog({text.replace(' ()', '')})"


def join_logs(logs: Sequence[BoxLog]) -> BoxLog:
    """Join logs in their order; their frame numbers must differ.

    Raises ValueError if there is none, or two have one frame, or other rigs or worlds of a scene.
    """
    if not logs:
        raise ValueError("no box log to join")
    if len(logs) == 1:
        return logs[0]
    rigs: dict[str, RecordedRig] = {}
    world: dict[str, StaticWorld] = {}
    for log in logs:
        for scene, rig in log.rigs.items():
            if rigs.setdefault(scene, rig) != rig:
                raise InputError("different rigs in two of the logs", place=f"scene {scene}")
        for scene, static in log.world.items():
            if world.setdefault(scene, static) is not static:
                raise InputError("a static world in two of the logs", place=f"scene {scene}")
    boxes, frames, buildings = (
        pd.concat([getattr(log, name) for log in logs], ignore_index=True)
        for name in ("boxes", "frames", "buildings")
    )
    if (row := first(frames["frame"].duplicated())) is not None:
        problem = "duplicate in two of the logs; frame numbers must differ"
        raise InputError(problem, place=f"frame {frames['frame'].iloc[row]}")
    return BoxLog(boxes, frames, buildings, rigs, world)


def of_split(log: BoxLog, split: str) -> BoxLog:
    """Keep the frames of a split, and their boxes."""
    frames = log.frames[log.frames["split"] == split]
    boxes = log.boxes[log.boxes["frame"].isin(frames["frame"])]
    return replace(log, boxes=boxes, frames=frames)


def write_box_log(folder: Path, log: BoxLog) -> None:
    """Write `boxes.parquet`, `frames.parquet`, `buildings.parquet`, `rig.json` and `world.npz`.

    They are renamed into place when all of them are written."""
    folder.mkdir(parents=True, exist_ok=True)
    optional = (*POSE_COLUMNS, *FULL_POSE_COLUMNS, VIEWPOINT_Z, SOURCE)
    further = [name for name in optional if name in log.frames.columns]
    if not log.rigs:
        (folder / RIG_FILE).unlink(missing_ok=True)
    if not log.world:
        (folder / WORLD_FILE).unlink(missing_ok=True)
    with ExitStack() as stack:
        for name, table, names in (
            ("frames", log.frames, (*FRAME_COLUMNS, *further)),
            ("buildings", log.buildings, BUILDING_COLUMNS),
            ("boxes", log.boxes, (*BOX_COLUMNS, *count_columns(log.boxes))),
        ):
            partial = stack.enter_context(replacing(folder / f"{name}.parquet"))
            with partial.open("wb") as file:  # pandas would take http:/… for an address
                table[list(names)].to_parquet(file, index=False)
        if log.rigs:
            partial = stack.enter_context(replacing(folder / RIG_FILE))
            rigs = {scene: asdict(rig) for scene, rig in log.rigs.items()}
            partial.write_text(json.dumps(rigs) + "\n", encoding="utf-8")
        if log.world:
            write_worlds(stack.enter_context(replacing(folder / WORLD_FILE)), log.world)


def evenly(frames: pd.DataFrame, most: int | None) -> pd.DataFrame:
    """Select at most so many rows of a table, spread evenly over it; all of them for None."""
    if most is None or most >= len(frames):
        return frames
    return frames.iloc[np.linspace(0, len(frames) - 1, most).round().astype(int)]


def read_box_log(folder: Path, most_frames: int | None = None) -> BoxLog:
    """Read what `write_box_log` wrote; `buildings.parquet`, `rig.json`, `world.npz` may be missing.

    Args:
        folder: the folder of the log.
        most_frames: read at most so many frames, spread evenly over the log; the boxes of others
            are not kept in memory.

    Raises ValueError that names file and row if a table cannot be read, lacks a column or has an
    invalid value, a box is in no frame of `frames`, a LiDAR has counts but is none of its scene's
    rig, or there are buildings or a world without poses."""
    if most_frames is None:
        boxes, frames = read_boxes(folder), read_frames(folder)
    else:
        frames = evenly(read_frames(folder), most_frames).reset_index(drop=True)
        boxes = read_boxes(folder, frames["frame"].tolist())
    check_listed(boxes, frames, str(folder / "boxes.parquet"), "frames.parquet")
    rigs = read_rigs(folder)
    _check_counted(rigs, boxes, folder / RIG_FILE)
    world = read_worlds(folder / WORLD_FILE) if is_there(folder / WORLD_FILE) else {}
    buildings = read_buildings(folder)
    if (len(buildings) or world) and (missing := set(POSE_COLUMNS) - set(frames.columns)):
        problem = "missing column; buildings and static worlds need the pose of the vehicle"
        raise InputError(problem, place=folder / "frames.parquet", key=", ".join(sorted(missing)))
    return BoxLog(boxes, frames, buildings, rigs, world)


def check_listed(boxes: pd.DataFrame, frames: pd.DataFrame, source: str, name: str) -> None:
    """Raise ValueError for the first box, of `source`, in no frame of the table `name`.

    Also if most boxes are of another time than their frame."""
    row = pd.Index(frames["frame"]).get_indexer(pd.Index(boxes["frame"]))
    columns.check_values(boxes, ["frame"], row < 0, f"one of {name}, which lists all", source)
    if "timestamp_s" not in boxes or "timestamp_s" not in frames or boxes.empty:
        return
    time, box_time = (table["timestamp_s"].to_numpy(np.float64) for table in (frames, boxes))
    several = boxes["timestamp_s"].nunique() > 1
    off = np.abs(box_time - time[row]) if several else np.zeros(len(box_time))
    step = frames.sort_values("frame")["timestamp_s"].diff().abs().median()
    if step > 0 and (far := off > step / 2).mean() > 0.5:
        problem = (
            f"the time is not that of the frame in {name} in {percent(far.mean())} of the rows"
        )
        parts = {"expected": f"{time[row][far][0]:.16g}", "fix": "are frame numbers off by one?"}
        parts |= {"place": f"{source}: row {int(far.argmax())}", "key": "timestamp_s"}
        raise InputError(problem, found=f"{box_time[far][0]:.16g}", **parts)


def read_rigs(folder: Path) -> dict[str, RecordedRig]:
    """Read the rigs by scene alone; none where there is no file.

    Raises ValueError for an invalid file."""
    path = folder / RIG_FILE
    if not is_there(path):
        return {}
    try:
        return _RIGS.validate_python(read_json(path))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"]))
        raise InputError(f"invalid rig: {first['msg']}", place=path, key=key) from None


def _check_counted(rigs: Mapping[str, RecordedRig], boxes: pd.DataFrame, path: Path) -> None:
    for name, column in points_of(boxes).items():
        for scene in boxes.loc[boxes[column].notna(), "scene"].unique():
            if scene in rigs and name not in rigs[scene].names:
                problem = "rig of other LiDARs than the counts in boxes.parquet"
                names, fix = ", ".join(rigs[scene].names), "convert the log again with its own rig"
                place = f"{path}: scene {scene}"
                raise InputError(problem, place=place, expected=name, found=names, fix=fix)


def read_frames(folder: Path) -> pd.DataFrame:
    """Read the table of frames alone; raise ValueError as `read_box_log` does."""
    source = str(folder / "frames.parquet")
    frames = read_parquet(folder / "frames.parquet")
    columns.check_columns(list(frames.columns), FRAME_COLUMNS, source)
    columns.one_of(frames, "split", SPLITS, source)
    poses = frames.columns.intersection([*POSE_COLUMNS, *FULL_POSE_COLUMNS, VIEWPOINT_Z])
    columns.no_text(frames, ["frame", "timestamp_s", *poses], source)
    frames["frame"] = columns.frame_numbers(frames, source)
    frames["route"] = columns.groups(frames, "route", source)
    for name in ("timestamp_s", *poses):
        frames[name] = columns.numbers_if_known(frames, name, source)
    frames = _with_texts(frames, ("scene", *([SOURCE] if SOURCE in frames else [])), source)
    columns.check_values(frames, ["frame"], frames["frame"].duplicated(), UNIQUE, source)
    return frames


def read_boxes(folder: Path, frames: Sequence[int] | None = None) -> pd.DataFrame:
    """Read the boxes alone; with `frames` those of others are not kept in memory.

    Raises ValueError as `read_box_log` does."""
    source = str(folder / "boxes.parquet")
    boxes = read_parquet(folder / "boxes.parquet", frames)
    columns.check_columns(list(boxes.columns), BOX_COLUMNS, source)
    counted = count_columns(boxes)
    columns.no_text(boxes, ["frame", "timestamp_s", *GEOMETRY, *counted], source)
    check_boxes(boxes, source)
    check_classes(boxes, source)
    boxes["frame"] = columns.frame_numbers(boxes, source)
    boxes["timestamp_s"] = columns.numbers_if_known(boxes, "timestamp_s", source)
    boxes[list(GEOMETRY)] = columns.numbers(boxes, GEOMETRY, source)
    for name in counted:
        boxes[name] = columns.counts_if_known(boxes, name, source)
    return _with_texts(boxes, ("scene", "object_id"), source)


def read_buildings(folder: Path) -> pd.DataFrame:
    """Read the buildings alone; none where there is no file.

    Raises ValueError for an invalid one."""
    if not is_there(path := folder / "buildings.parquet"):
        return _no_buildings()
    buildings, source = read_parquet(path), str(path)
    columns.check_columns(list(buildings.columns), BUILDING_COLUMNS, source)
    columns.no_text(buildings, GEOMETRY, source)
    buildings[list(GEOMETRY)] = columns.numbers(buildings, GEOMETRY, source)
    columns.sizes(buildings, SIZE, source)
    return _with_texts(buildings, ("scene",), source)


def _with_texts(table: pd.DataFrame, names: Sequence[str], source: str) -> pd.DataFrame:
    """Turn names that are numbers into text, which joins with other tables."""
    return table.assign(**{name: columns.texts(table, name, source) for name in names})
