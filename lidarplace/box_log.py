"""A box log as a whole: its tables, and the folder that holds them."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd
import pyarrow as pa

from lidarplace.boxes import (
    BOX_COLUMNS,
    BUILDING_COLUMNS,
    FRAME_COLUMNS,
    POSE_COLUMNS,
    check_boxes,
)
from lidarplace.files import replacing


def _no_buildings() -> pd.DataFrame:
    columns = {"scene": pd.Series(dtype=str)}
    return pd.DataFrame(columns | {c: pd.Series(dtype=float) for c in BUILDING_COLUMNS[1:]})


@dataclass(frozen=True)
class BoxLog:
    """What was around the vehicle in every frame.

    Attributes:
        boxes: one row a box, columns `BOX_COLUMNS`, ego frame.
        frames: one row a frame, columns `FRAME_COLUMNS`; frames without boxes too. A source that
            knows where the vehicle was adds `POSE_COLUMNS`.
        buildings: what stands still and is no object: columns `BUILDING_COLUMNS`, in the world
            frame of its scene, in which `POSE_COLUMNS` place the vehicle. Mostly empty.
    """

    boxes: pd.DataFrame
    frames: pd.DataFrame
    buildings: pd.DataFrame = field(default_factory=_no_buildings)


def join_logs(logs: Sequence[BoxLog]) -> BoxLog:
    """One log of several, in their order; their frame numbers must differ.

    Raises:
        ValueError: there is no log, or a frame number occurs in two of them.
    """
    if not logs:
        raise ValueError("no box log to join")
    if len(logs) == 1:
        return logs[0]
    joined = BoxLog(
        *(
            pd.concat([getattr(log, name) for log in logs], ignore_index=True)
            for name in ("boxes", "frames", "buildings")
        )
    )
    twice = joined.frames["frame"].duplicated()
    if twice.any():
        frame = joined.frames.loc[twice, "frame"].iloc[0]
        raise ValueError(f"frame {frame} is in two of the logs; frame numbers must differ")
    return joined


def write_box_log(folder: Path, log: BoxLog) -> None:
    """Write `boxes.parquet`, `frames.parquet` and `buildings.parquet`.

    They are renamed into place when all of them are written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    poses = [name for name in POSE_COLUMNS if name in log.frames.columns]
    with ExitStack() as stack:
        for name, table, columns in (
            ("frames", log.frames, (*FRAME_COLUMNS, *poses)),
            ("buildings", log.buildings, BUILDING_COLUMNS),
            ("boxes", log.boxes, BOX_COLUMNS),
        ):
            partial = stack.enter_context(replacing(folder / f"{name}.parquet"))
            table[list(columns)].to_parquet(partial, index=False)


def read_box_log(folder: Path) -> BoxLog:
    """Read what `write_box_log` wrote; `buildings.parquet` may be missing.

    Raises:
        ValueError: a table cannot be read or lacks a column, a box is bad, or a box is in no frame
            of `frames`.
    """
    boxes = _table(folder / "boxes.parquet", BOX_COLUMNS)
    check_boxes(boxes, str(folder / "boxes.parquet"))
    frames = read_frames(folder)
    unlisted = ~boxes["frame"].isin(frames["frame"]).to_numpy()
    if unlisted.any():
        row = int(unlisted.argmax())
        raise ValueError(
            f"{folder / 'boxes.parquet'}: row {row}: frame {boxes['frame'].iloc[row]} is not in "
            "frames.parquet, which lists every frame"
        )
    path = folder / "buildings.parquet"
    if not path.exists():
        return BoxLog(boxes, frames)
    buildings = _table(path, BUILDING_COLUMNS)
    if len(buildings) and (missing := set(POSE_COLUMNS) - set(frames.columns)):
        raise ValueError(
            f"{folder / 'frames.parquet'}: no column {', '.join(sorted(missing))}; "
            "buildings need the pose of the vehicle"
        )
    return BoxLog(boxes, frames, buildings)


def read_frames(folder: Path) -> pd.DataFrame:
    """The table of frames alone. Raises ValueError as `read_box_log` does."""
    path = folder / "frames.parquet"
    frames = _table(path, FRAME_COLUMNS)
    twice = frames["frame"].duplicated().to_numpy()
    if twice.any():
        row = int(twice.argmax())
        raise ValueError(
            f"{path}: row {row}: frame {frames['frame'].iloc[row]} is there twice; a frame has a "
            "number of its own in the whole log, whatever its scene"
        )
    return frames


def _table(path: Path, columns: Sequence[str]) -> pd.DataFrame:
    try:
        table = pd.read_parquet(path)
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror or 'no such file'}") from None
    except pa.ArrowInvalid as error:
        raise ValueError(f"{path}: is no Parquet file: {str(error).splitlines()[0]}") from None
    missing = [name for name in columns if name not in table.columns]
    if missing:
        raise ValueError(f"{path}: no column {', '.join(missing)}; found {list(table.columns)}")
    return table
