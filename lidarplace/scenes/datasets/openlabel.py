"""Box logs from ASAM OpenLABEL: cuboids of JSON files, a drive each.

https://www.asam.net/standards/detail/openlabel has the standard."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from lidarplace.base.errors import InputError, at
from lidarplace.configuration.record import read_record
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import FRAME_COLUMNS, GEOMETRY, POSE_COLUMNS
from lidarplace.scenes.datasets.class_maps import BOX_LOG, ClassMap, classify, merged
from lidarplace.scenes.datasets.drives import Drive, in_frames, join_drives
from lidarplace.scenes.datasets.openlabel_file import VEHICLE, Content, Matrix, OpenLabel, Systems

LEAST_UPRIGHT = np.cos(np.radians(30))  # vertical part of the upright axis of a cuboid


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
    """Read the cuboids of a file, or of all `.json` files of a folder, as one box log.

    A file is a scene and a route, called by its name; its frames are those that it lists. An object
    without a cuboid in a frame has none there; one whose cuboid is given once is in all its frames.
    Where transforms lead from the vehicle to the root of its coordinate systems, frames have poses.

    Args:
        source: the file, or the folder of files.
        origin: where the file's vehicle frame starts in our ego frame, x, y, z in metres.
        vehicle: name of the vehicle's coordinate system; None: the one of type `local_cs`.
        seconds: what the unit of a time stamp that is a number lasts. Others are dates of ISO 8601.
        test: names of files, without suffix, whose frames are test.
        class_map: from types of objects to classes; our own stand for themselves.
        ignored: gets the number of boxes left out by type.

    Raises ValueError if a file is wrong, a type unknown, or no transform leads to the vehicle."""
    classes = merged(BOX_LOG, class_map)
    paths = sorted(source.glob("[!.]*.json")) if source.is_dir() else [source]
    if not paths:
        raise InputError(place=source, expected="a file .json for each drive")
    for name in test:
        if name not in [path.stem for path in paths]:
            listed = ", ".join(path.stem for path in paths)
            raise InputError(f"no file of the test drive {name}", place=source, found=listed)

    def read(path: Path, start: int) -> Drive:
        content = read_record(path, OpenLabel, "OpenLABEL file").openlabel
        with at(path):
            system = _vehicle(content, vehicle)
            frames = _frames(content, system, origin, seconds).assign(scene=path.stem)
            frames["frame"] += start
            boxes = _boxes(content, system)
            boxes[list("xyz")] += np.asarray(origin)
            boxes = in_frames(frames, boxes["row"].to_numpy(np.int64), dict(boxes.items()))
            where = [f"object {uid}" for uid in boxes["object_id"]]
            boxes["class"] = classify(boxes["type"], classes, where.__getitem__, ignored)
        return boxes, frames, None

    log = join_drives([(path, "test" if path.stem in test else "train") for path in paths], read)
    poses = () if log.frames[POSE_COLUMNS[0]].isna().any() else POSE_COLUMNS
    return replace(log, frames=log.frames[[*FRAME_COLUMNS, *poses]])


def _frames(
    content: Content, vehicle: str, origin: Sequence[float], seconds: float
) -> pd.DataFrame:
    """Number frames of a drive from 0, and place our ego frame in them; NaN where not known."""
    root, seen, systems = vehicle, {vehicle}, content.coordinate_systems
    while root in systems and (parent := systems[root].parent) and parent not in seen:
        root = parent
        seen.add(root)
    numbers = sorted(content.frames)
    pose = np.full((len(numbers), 3), np.nan)
    for row, number in enumerate(numbers):
        matrix = Systems(content, content.frames[number]).between(vehicle, root)
        if root != vehicle and matrix is not None:
            place = matrix[:3, 3] - matrix[:3, :3] @ np.asarray(origin)
            pose[row] = *place[:2], np.arctan2(matrix[1, 0], matrix[0, 0])
    stamps = [content.frames[number].frame_properties.timestamp for number in numbers]
    time = np.array([_time(stamp, seconds) for stamp in stamps])
    return pd.DataFrame(
        {
            "frame": np.arange(len(numbers)),
            "timestamp_s": time - np.nanmin(time) if np.isfinite(time).any() else time,
            **dict(zip(POSE_COLUMNS, pose.T, strict=True)),
        }
    )


def _vehicle(content: Content, name: str | None) -> str:
    systems = content.coordinate_systems
    vehicles = [each for each, system in systems.items() if system.type == VEHICLE]
    if name is None and len(vehicles) == 1:
        return vehicles[0]
    if name is None or name not in systems:
        listed = ", ".join(f"{each} ({system.type})" for each, system in systems.items())
        expected, fix = "the coordinate system of the vehicle", "name it by --vehicle"
        raise InputError(expected=expected, found=listed or "none", fix=fix)
    return name


def _time(stamp: str | float | None, seconds: float) -> float:
    """Convert a time stamp to seconds, NaN if there is none."""
    if stamp is None:
        return math.nan
    for unit, read in ((seconds, float), (1.0, lambda date: pd.Timestamp(date).timestamp())):
        with suppress(ValueError, TypeError, OverflowError):
            if math.isfinite(time := float(read(stamp))):
                return time * unit
    raise InputError(key="timestamp", expected="a number or a date of ISO 8601", found=repr(stamp))


def _boxes(content: Content, vehicle: str) -> pd.DataFrame:
    """List boxes of a drive: `row` of the frame, `object_id`, `type`, `GEOMETRY` in the vehicle."""
    rows = [
        (row, *box)
        for row, number in enumerate(sorted(content.frames))
        for box in _boxes_of_frame(content, number, vehicle)
    ]
    boxes = pd.DataFrame(rows, columns=["row", "object_id", "type", *GEOMETRY])
    return boxes.astype(dict.fromkeys(GEOMETRY, np.float64))


def _boxes_of_frame(
    content: Content, number: int, vehicle: str
) -> Iterator[tuple[str | float, ...]]:
    """Return object, type and geometry of every box of a frame, in the vehicle's system."""
    frame = content.frames[number]
    systems = Systems(content, frame)
    to_vehicle: dict[str, Matrix] = {}
    for uid in dict.fromkeys([*frame.objects, *content.objects]):
        where = f"frame {number}, object {uid}"
        if uid not in content.objects:
            raise InputError("not among the objects of the file", place=where)
        labelled = content.objects[uid]
        spans = [range(span.frame_start, span.frame_end + 1) for span in labelled.frame_intervals]
        cuboids = frame.objects[uid].object_data.cuboid if uid in frame.objects else []
        if not cuboids and (not spans or any(number in span for span in spans)):
            cuboids = labelled.object_data.cuboid
        if not cuboids:
            continue
        if len(cuboids) > 1:
            raise InputError(place=where, expected="one cuboid", found=len(cuboids))
        system = cuboids[0].coordinate_system or labelled.coordinate_system or vehicle
        if system not in to_vehicle:
            matrix = systems.between(system, vehicle)
            if matrix is None:
                raise InputError(f"no transform leads from {system} to {vehicle}", place=where)
            to_vehicle[system] = matrix
        pose = to_vehicle[system] @ cuboids[0].pose()
        yaw = float(np.arctan2(pose[1, 0], pose[0, 0]))
        sizes = _upright(pose, cuboids[0].val[-3:], f"{where} in {system}")
        yield uid, labelled.type, *pose[:3, 3].tolist(), *sizes, yaw


def _upright(pose: Matrix, sizes: Sequence[float], where: str) -> list[float]:
    """Return length, width and height of sizes along a cuboid's own axes, by the upright one.

    In the frame of a camera that is y. Raises ValueError if x is upright, or no axis is."""
    upright = int(np.abs(pose[2, :3]).argmax())
    if upright == 0 or abs(pose[2, upright]) < LEAST_UPRIGHT:
        slope = np.degrees(np.arcsin(np.abs(pose[2, :3]).clip(0, 1))).round()
        found = f"slopes of {slope[0]:g}, {slope[1]:g} and {slope[2]:g} degrees"
        fix = "correct the transforms of its coordinate system"
        expected = "a cuboid on the ground, its y or z axis upright"
        raise InputError(place=where, expected=expected, found=found, fix=fix)
    return [sizes[0], sizes[3 - upright], sizes[upright]]
