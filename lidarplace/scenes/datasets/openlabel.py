"""Box logs from ASAM OpenLABEL: cuboids of JSON files, a drive each.

https://www.asam.net/standards/detail/openlabel has the standard.
"""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.class_names import IGNORE
from lidarplace.configuration.record import read_record
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import BOX_COLUMNS, FRAME_COLUMNS, GEOMETRY, POSE_COLUMNS
from lidarplace.scenes.datasets.class_maps import BOX_LOG, ClassMap, classify, merged
from lidarplace.scenes.datasets.openlabel_file import (
    VEHICLE,
    Content,
    LabelledObject,
    Matrix,
    OpenLabel,
    Systems,
)


def read_openlabel(
    source: Path,
    *,
    origin: Sequence[float],
    vehicle: str | None = None,
    seconds: float = 1.0,
    test: Sequence[str] = (),
    class_map: ClassMap | None = None,
    ignored: Counter[str] | None = None,
) -> BoxLog:
    """The cuboids of a file, or of all `.json` files of a folder, as one box log.

    A file is a scene and a route, called by its name; its frames are those that it lists. An object
    without a cuboid in a frame has none there; one whose cuboid is given once is in all its frames.
    Where transforms lead from the vehicle to the root of its coordinate systems, frames have poses.

    Args:
        origin: where the file's vehicle frame starts in our ego frame, x, y, z in metres.
        vehicle: name of the vehicle's coordinate system; None: the one of type `local_cs`.
        seconds: what the unit of a time stamp that is a number lasts. Others are dates of ISO 8601.
        test: names of files, without suffix, whose frames are test.
        class_map: from types of objects to classes; our own stand for themselves.
        ignored: gets the number of boxes left out by type.

    Raises:
        ValueError: a file is missing or wrong, a type is unknown, or no transform leads from a
            cuboid to the vehicle.
    """
    class_map = merged(BOX_LOG, class_map)
    paths = sorted(source.glob("*.json")) if source.is_dir() else [source]
    if not paths:
        raise ValueError(f"{source}: must hold a file .json for each drive")
    for name in test:
        if name not in [path.stem for path in paths]:
            listed = ", ".join(path.stem for path in paths)
            raise ValueError(f"{source}: no file of the test drive {name}; found {listed}")
    counter = Counter[str]() if ignored is None else ignored
    boxes: list[pd.DataFrame] = []
    frames: list[pd.DataFrame] = []
    for route, path in enumerate(paths):
        content = read_record(path, OpenLabel, "OpenLABEL file").openlabel
        own = _vehicle(content, vehicle, path)
        table = _frames(content, own, origin, seconds, path)
        table["frame"] += sum(map(len, frames))
        found = _boxes(content, own, path)
        found[list("xyz")] += np.asarray(origin)
        row = found["row"].to_numpy(np.int64)
        for name in ("scene", "frame", "timestamp_s"):
            found[name] = table[name].to_numpy()[row]
        where = [f"{path}: object {uid}" for uid in found["object_id"]]
        found["class"] = classify(found["type"], class_map, where.__getitem__, counter)
        boxes.append(found.loc[found["class"] != IGNORE, list(BOX_COLUMNS)])
        frames.append(table.assign(route=route, split="test" if path.stem in test else "train"))
    every = pd.concat(frames, ignore_index=True)
    poses = () if every[POSE_COLUMNS[0]].isna().any() else POSE_COLUMNS
    return BoxLog(pd.concat(boxes, ignore_index=True), every[[*FRAME_COLUMNS, *poses]])


def _frames(
    content: Content, vehicle: str, origin: Sequence[float], seconds: float, path: Path
) -> pd.DataFrame:
    """Frames of a drive, numbered from 0, and where our ego frame was, as far as it is known."""
    numbers = sorted(content.frames)
    stamps = [content.frames[number].frame_properties.timestamp for number in numbers]
    time = np.array([_time(stamp, seconds, path) for stamp in stamps])
    return pd.DataFrame(
        {
            "scene": path.stem,
            "frame": np.arange(len(numbers)),
            "timestamp_s": time - np.nanmin(time) if np.isfinite(time).any() else time,
            **_poses(content, vehicle, numbers, origin),
        }
    )


def _vehicle(content: Content, name: str | None, path: Path) -> str:
    """The name of the vehicle's coordinate system."""
    systems = content.coordinate_systems
    found = [each for each, system in systems.items() if system.type == VEHICLE]
    if name is None and len(found) == 1:
        return found[0]
    if name is None or name not in systems:
        listed = ", ".join(f"{each} ({system.type})" for each, system in systems.items())
        raise ValueError(
            f"{path}: which coordinate system is the vehicle's? Name it by --vehicle; found "
            f"{listed or 'none'}"
        )
    return name


def _time(stamp: str | float | None, seconds: float, path: Path) -> float:
    """A time stamp in seconds, NaN if there is none."""
    if stamp is None:
        return math.nan
    for unit, read in ((seconds, float), (1.0, lambda date: pd.Timestamp(date).timestamp())):
        with suppress(ValueError, TypeError, OverflowError):
            if math.isfinite(time := float(read(stamp))):
                return time * unit
    raise ValueError(f"{path}: timestamp must be a number or a date of ISO 8601, found {stamp!r}")


def _poses(
    content: Content, vehicle: str, numbers: Sequence[int], origin: Sequence[float]
) -> Mapping[str, NDArray[np.float64]]:
    """`POSE_COLUMNS` of our ego frame in the root of the vehicle's systems; NaN if not known."""
    root, seen = vehicle, {vehicle}
    while (parent := _parent(content, root)) and parent not in seen:
        root = parent
        seen.add(root)
    pose = np.full((len(numbers), 3), np.nan)
    for row, number in enumerate(numbers):
        matrix = Systems.of(content, content.frames[number]).between(vehicle, root)
        if root != vehicle and matrix is not None:
            place = matrix[:3, 3] - matrix[:3, :3] @ np.asarray(origin)
            pose[row] = *place[:2], np.arctan2(matrix[1, 0], matrix[0, 0])
    return dict(zip(POSE_COLUMNS, pose.T, strict=True))


def _parent(content: Content, name: str) -> str:
    system = content.coordinate_systems.get(name)
    return "" if system is None else system.parent


def _boxes(content: Content, vehicle: str, path: Path) -> pd.DataFrame:
    """Boxes of a drive: `row` of the frame, `object_id`, `type` and `GEOMETRY` in the vehicle."""
    rows = [
        (row, uid, kind, *geometry)
        for row, number in enumerate(sorted(content.frames))
        for uid, kind, geometry in _boxes_of_frame(content, number, vehicle, path)
    ]
    boxes = pd.DataFrame(rows, columns=["row", "object_id", "type", *GEOMETRY])
    return boxes.astype(dict.fromkeys(GEOMETRY, np.float64))


def _boxes_of_frame(
    content: Content, number: int, vehicle: str, path: Path
) -> Iterator[tuple[str, str, tuple[float, ...]]]:
    """Object, type and geometry of every box of a frame, in the vehicle's system."""
    frame = content.frames[number]
    systems = Systems.of(content, frame)
    to_vehicle: dict[str, Matrix] = {}
    uids = [*frame.objects, *(uid for uid in content.objects if uid not in frame.objects)]
    for uid in uids:
        where = f"{path}: frame {number}, object {uid}"
        if uid not in content.objects:
            raise ValueError(f"{where}: is not among the objects of the file")
        known = content.objects[uid]
        own = frame.objects[uid].object_data.cuboid if uid in frame.objects else []
        if not own and _lasts(known, number):
            own = known.object_data.cuboid
        if not own:
            continue
        if len(own) > 1:
            raise ValueError(f"{where}: has {len(own)} cuboids; leave one in the file")
        system = own[0].coordinate_system or known.coordinate_system or vehicle
        if system not in to_vehicle:
            matrix = systems.between(system, vehicle)
            if matrix is None:
                raise ValueError(f"{where}: no transform leads from {system} to {vehicle}")
            to_vehicle[system] = matrix
        pose = to_vehicle[system] @ own[0].pose()
        yaw = float(np.arctan2(pose[1, 0], pose[0, 0]))
        yield uid, known.type, (*pose[:3, 3].tolist(), *own[0].val[-3:], yaw)


def _lasts(known: LabelledObject, number: int) -> bool:
    """Whether an object is there in a frame; without intervals it is in all."""
    intervals = known.frame_intervals
    return not intervals or any(each.frame_start <= number <= each.frame_end for each in intervals)
