"""A data set in the layout of Argoverse 2's sensor data set; see `scenes.layouts`."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.scenes.datasets.argoverse import COUNT, ORIGIN, QUATERNION, SIZE, TRANSLATION
from lidarplace.scenes.datasets.se3 import Poses

CATEGORIES = {"Car": "REGULAR_VEHICLE", "Cyclist": "BICYCLIST", "Pedestrian": "PEDESTRIAN"}
"""Categories of our classes; others keep their names."""


def names_of(frames: pd.DataFrame) -> pd.Series:
    """LOG/TIMESTAMP_NS of each frame."""
    return frames["sequence"] + "/" + (1000 * frames["time_us"]).astype(str)


def path_of(frame: Any) -> str:
    """The file of a frame's cloud."""
    return f"{frame.split}/{frame.sequence}/sensors/lidar/{1000 * frame.time_us}.feather"


def write_sweep(path: Path, points: NDArray[np.float32]) -> None:
    """Write points, ego frame, shape (n, 4); all are of laser 0."""
    sweep = pd.DataFrame(points[:, :3] + np.array(ORIGIN, np.float32), columns=list("xyz"))
    sweep["intensity"] = np.round(255 * points[:, 3]).astype(np.uint8)
    sweep.assign(laser_number=np.uint8(0), offset_ns=np.int32(0)).to_feather(path)


def write_tables(folder: Path, frames: pd.DataFrame, boxes: pd.DataFrame) -> None:
    """Write poses, and annotations of logs to train.

    Args:
        frames: with poses, `sequence` and `time_us`.
        boxes: of frames to train, with `time_us`, and `points` in each.
    """
    ego = _columns(Poses.of_ego(frames).moved([-own for own in ORIGIN]), frames)
    own = Poses.of_boxes(boxes)
    annotations = _columns(Poses(own.position + ORIGIN, own.rotation), boxes).assign(
        track_uuid=boxes["object_id"].astype(str),
        category=boxes["class"].map(lambda name: CATEGORIES.get(name, name)),
        **{COUNT: boxes["points"]},
        **{name: boxes[name.removesuffix("_m")] for name in SIZE},
    )
    logs = frames["split"] + "/" + frames["sequence"]
    for log in logs.unique():
        own_ego = ego[logs == log].reset_index(drop=True)
        own_ego.to_feather(folder / log / "city_SE3_egovehicle.feather")
        if log.startswith("train/"):
            of_log = annotations[boxes["frame"].isin(frames.loc[logs == log, "frame"])]
            of_log.reset_index(drop=True).to_feather(folder / log / "annotations.feather")


def _columns(poses: Poses, of: pd.DataFrame) -> pd.DataFrame:
    values = np.concatenate([poses.quaternions, poses.position], axis=1)
    table = pd.DataFrame(values, of.index, [*QUATERNION, *TRANSLATION])
    return table.assign(timestamp_ns=1000 * of["time_us"])
