"""Contents of one frame of a box log."""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.clouds.clouds import Crop
from lidarplace.clouds.collect import collect, crop_for
from lidarplace.clouds.points_in_boxes import MARGIN_M, count_points
from lidarplace.clouds.shapes import BUILDING
from lidarplace.clouds.surroundings import Surroundings
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.placement import Placement


@dataclass(frozen=True)
class Frame:
    """Surroundings in one frame, in the ego frame: its part of the log, and its row.

    `objects`, rows of `boxes`, and `buildings`, rows of `lidarplace.logs.boxes.GEOMETRY`, (B, 7),
    may reach into the crop; `inside`, (objects,), says which objects have their centre in it."""

    log: BoxLog
    row: pd.Series
    objects: pd.DataFrame
    inside: NDArray[np.bool_]
    buildings: NDArray[np.float64]


def busiest_frame(log: BoxLog, crop: Crop) -> int:
    """Find the first of the frames with most boxes in the crop.

    Raises ValueError without a frame."""
    if log.frames.empty:
        raise ValueError("the log has no frame")
    inside = centres_in(crop, log.boxes)
    numbers = log.frames["frame"].to_numpy(np.int64)
    counts = log.boxes.loc[inside, "frame"].value_counts().reindex(numbers, fill_value=0)
    return int(numbers[np.argmax(counts.to_numpy())])


def read_frame(log: BoxLog, number: int, crop: Crop) -> Frame:
    """Select what surrounds the vehicle in frame `number`.

    Raises ValueError: the log has no such frame, a box is bad, or a pose is missing."""
    rows = log.frames[log.frames["frame"] == number]
    if rows.empty:
        listed = log.frames["frame"]
        expected = f"one of {len(listed)} frames, {listed.min()} to {listed.max()}"
        expected = expected if len(listed) else "a log with frames"
        raise InputError(key="frame", expected=expected, found=number)
    row = rows.iloc[0]
    part = replace(
        log,
        boxes=log.boxes[log.boxes["frame"] == number],
        frames=rows,
        buildings=log.buildings[log.buildings["scene"] == row["scene"]],
    )
    geometry = part.boxes[list(GEOMETRY)].to_numpy(np.float64)
    near = _near(geometry, crop)
    parts = Surroundings(part).parts(number, reach=np.inf)
    buildings = parts.geometry[parts.owner == BUILDING, : len(GEOMETRY)]
    objects = part.boxes[near]
    return Frame(part, row, objects, centres_in(crop, objects), buildings[_near(buildings, crop)])


def read_cloud(
    frame: Frame,
    placement: Placement,
    crop: Crop,
    most: int,
    misaligned_heights: bool = False,
    vehicle: Vehicle | None = None,
) -> tuple[NDArray[np.float32], NDArray[np.uint8], int, NDArray[np.int64]]:
    """Simulate the cloud of `placement` within the crop and on the ground under it, as sweeps do.

    Returns its points, (n, 3), metres, ego frame, beyond `most` a random choice of them, and the
    mount of each; the number before, and that on each of `Frame.objects`. The vehicle is a sedan
    for None. LiDARs fire all rays at once, as a single frame shows no motion."""
    reach = crop_for(crop[::3], crop[1::3], crop[2::3], placement, misaligned_heights)
    numbers, placement = [frame.row["frame"]], placement.at_once()
    clouds = collect(frame.log, numbers, placement, reach, 0, misaligned_heights, vehicle=vehicle)
    points, lidar = clouds[0], clouds.lidar(0)
    drawn = np.arange(len(points))
    if len(points) > most:
        drawn = np.sort(np.random.default_rng(0).choice(len(points), most, replace=False))
    boxes = frame.objects[list(GEOMETRY)].to_numpy(np.float64)
    grown = boxes + np.array([0, 0, 0, 2, 2, 2, 0]) * MARGIN_M
    return points[drawn, :3], lidar[drawn], len(points), count_points(points, grown)


def centres_in(crop: Crop, boxes: pd.DataFrame) -> NDArray[np.bool_]:
    """Return whether the centres of boxes are in the crop, faces included."""
    centres = boxes[list(GEOMETRY[:3])].to_numpy(np.float64)
    return np.asarray(((centres >= crop[:3]) & (centres <= crop[3:])).all(axis=1))


def _near(boxes: NDArray[np.float64], crop: Crop) -> NDArray[np.bool_]:
    """Return whether the spheres around boxes (m, 7) meet the crop."""
    outside = boxes[:, :3] - np.clip(boxes[:, :3], crop[:3], crop[3:])
    radius = 0.5 * np.linalg.norm(boxes[:, 3:6], axis=1)
    return np.asarray(np.linalg.norm(outside, axis=1) <= radius)
