"""Frames for other tools, test ones without labels: in KITTI's layout or as plain files."""

from pathlib import Path
from typing import Literal

import pandas as pd

from lidarplace.clouds.clouds import Clouds
from lidarplace.logs.boxes import BOX_COLUMNS, SOURCE
from lidarplace.scenes.kitti.labels import to_labels
from lidarplace.scenes.kitti.read import frame_name
from lidarplace.scenes.kitti.write import write_kitti

LayoutName = Literal["kitti", "parquet"]


def write_layout(
    layout: LayoutName, folder: Path, frames: pd.DataFrame, labels: pd.DataFrame, clouds: Clouds
) -> pd.DataFrame:
    """Write clouds of frames, and labels of those to train, to a new folder.

    Layout kitti: `training` and, without labels, `testing`; parquet: `clouds/FRAME.bin` (x, y, z,
    intensity; float32), `boxes.parquet` and `frames.parquet`, ego frame. Labels have the columns of
    `lidarplace.clouds.visibility.ground_truth`. Returns the frames with `SOURCE`, what the layout
    calls each. Raises OSError, and ValueError for a negative frame."""
    named_frames = frames.assign(**{SOURCE: frames["frame"].map(frame_name)})
    if layout == "kitti":
        write_kitti(folder, frames, [(to_labels(labels), clouds)], secret=True)
        return named_frames
    (folder / "clouds").mkdir(parents=True)
    for frame, points in zip(clouds.frames.tolist(), clouds, strict=True):
        points.astype("<f4", copy=False).tofile(folder / "clouds" / f"{frame_name(frame)}.bin")
    named_frames.to_parquet(folder / "frames.parquet", index=False)
    labels[list(BOX_COLUMNS)].to_parquet(folder / "boxes.parquet", index=False)
    return named_frames
