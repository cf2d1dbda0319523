"""Frames to train and to test in the layouts of data sets, for programs of others.

What there is to be found in the frames to test is left out: no program that reads these files has
seen it.
"""

from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd

from lidarplace.clouds.clouds import Clouds
from lidarplace.clouds.points_in_boxes import count_points
from lidarplace.logs.boxes import BOX_COLUMNS, FULL_POSE_COLUMNS, GEOMETRY, POSE_COLUMNS, SOURCE
from lidarplace.scenes.datasets import write_argoverse, write_nuscenes, write_plain
from lidarplace.scenes.kitti.folder import frame_name
from lidarplace.scenes.kitti.labels import to_labels
from lidarplace.scenes.kitti.write import write_kitti

LayoutName = Literal["kitti", "nuscenes", "argoverse", "parquet"]
_WRITERS = {"nuscenes": write_nuscenes, "argoverse": write_argoverse, "parquet": write_plain}
"""Modules that say what a frame is called and where its cloud is, and write that and the rest."""
STEP_S = 0.1
"""Between frames of which the log does not know the times."""


def write_layout(
    layout: LayoutName, folder: Path, frames: pd.DataFrame, labels: pd.DataFrame, clouds: Clouds
) -> pd.DataFrame:
    """Write clouds of frames, and labels of those to train.

    Args:
        layout: kitti: `training` and, without labels, `testing`; nuscenes: `v1.0-trainval` and,
            without annotations, `v1.0-test`; argoverse: `train` and, without annotations, `test`;
            parquet: `clouds/FRAME.bin` (x, y, z, intensity; float32), `boxes.parquet` and
            `frames.parquet`, ego frame.
        folder: new.
        frames: of a box log.
        labels: of frames to train, columns of `lidarplace.clouds.visibility.ground_truth`.
        clouds: of the frames.

    Returns:
        The frames with `SOURCE`, what the layout calls each, and the poses that it has of them.

    Raises:
        OSError: a file cannot be written.
        ValueError: a frame number is negative.
    """
    frames = _in_sequences(frames)
    if layout == "kitti":
        write_kitti(folder, frames, [(to_labels(labels), clouds)], secret=True)
        return frames.assign(**{SOURCE: frames["frame"].map(frame_name)})
    writer = _WRITERS[layout]
    frames[SOURCE] = writer.names_of(frames)
    poses = frames[["frame", "time_us", *POSE_COLUMNS, *FULL_POSE_COLUMNS]]
    boxes = poses.merge(labels[list(BOX_COLUMNS)], on="frame").assign(points=0)
    rows = {row.frame: row for row in frames.itertuples()}
    for frame, points in zip(clouds.frames.tolist(), clouds, strict=True):
        own = boxes["frame"] == frame
        geometry = boxes.loc[own, list(GEOMETRY)].to_numpy(np.float64)
        boxes.loc[own, "points"] = count_points(points, geometry)
        path = folder / writer.path_of(rows[frame])
        path.parent.mkdir(parents=True, exist_ok=True)
        writer.write_sweep(path, points)
    writer.write_tables(folder, frames, boxes)
    return frames


def _in_sequences(frames: pd.DataFrame) -> pd.DataFrame:
    """The frames with whole poses, `sequence` (a name for scene and route) and `time_us`.

    A vehicle whose pose is unknown stands at the origin. Times start at 0 in every sequence and
    grow with the rows.
    """
    names = [*POSE_COLUMNS, *FULL_POSE_COLUMNS]
    frames = frames.sort_values(["scene", "route", "timestamp_s", "frame"], ignore_index=True)
    groups = frames.groupby(["scene", "route"], sort=False)
    time = frames["timestamp_s"] - groups["timestamp_s"].transform("min")
    if (
        frames["timestamp_s"].isna().any()
        or frames.duplicated(["scene", "route", "timestamp_s"]).any()
    ):
        time = STEP_S * groups.cumcount()
    clean = frames["scene"].astype(str).str.replace(r"[^\w.-]+", "_", regex=True).str[:80]
    return frames.assign(
        sequence=groups.ngroup().map("{:04d}-".format) + clean,
        time_us=(1e6 * time).round().astype(np.int64),
        **frames.reindex(columns=names).fillna(0.0),
    )
