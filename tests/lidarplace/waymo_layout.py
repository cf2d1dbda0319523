"""Writes a small data set in the layout of Waymo's perception data set v2.

Columns and their types are those of `v2/perception/box.py`, `pose.py` and `base.py` of
https://github.com/waymo-research/waymo-open-dataset, a file a segment.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

CALIBRATION = "[LiDARCalibrationComponent]"
BOX, POSE = "[LiDARBoxComponent]", "[VehiclePoseComponent]"


class Box(NamedTuple):
    time_us: int
    kind: int
    centre: tuple
    size: tuple = (4.5, 1.9, 1.6)  # length, width, height
    heading: float = 0.0
    name: str = "a"


class Segment(NamedTuple):
    split: str
    name: str
    poses: dict  # time in microseconds -> (4, 4)
    boxes: tuple | list = ()
    lidars: dict | None = None  # number -> (extrinsic (4, 4), inclinations)


def write_waymo(folder: Path, segments: list) -> Path:
    for segment in segments:
        keys = {"key.segment_context_name": pa.array([segment.name] * len(segment.boxes))}
        sides = {
            f"{part}.{axis}": [getattr(b, attribute)[i] for b in segment.boxes]
            for part, attribute in (("center", "centre"), ("size", "size"))
            for i, axis in enumerate("xyz")
        }
        columns = {
            "key.frame_timestamp_micros": pa.array([b.time_us for b in segment.boxes], pa.int64()),
            "key.laser_object_id": pa.array([b.name for b in segment.boxes], pa.string()),
            **{
                f"{BOX}.box.{name}": pa.array(values, pa.float64())
                for name, values in sides.items()
            },
            f"{BOX}.box.heading": pa.array([b.heading for b in segment.boxes], pa.float64()),
            f"{BOX}.type": pa.array([b.kind for b in segment.boxes], pa.int8()),
            f"{BOX}.num_lidar_points_in_box": pa.array([7] * len(segment.boxes), pa.int64()),
            f"{BOX}.num_top_lidar_points_in_box": pa.array([4] * len(segment.boxes), pa.int64()),
        }
        _write(folder, segment, "lidar_box", keys | columns)
        matrices = [np.ravel(matrix).tolist() for matrix in segment.poses.values()]
        poses = {
            "key.segment_context_name": pa.array([segment.name] * len(segment.poses)),
            "key.frame_timestamp_micros": pa.array(list(segment.poses), pa.int64()),
            f"{POSE}.world_from_vehicle.transform": pa.array(matrices, pa.list_(pa.float64(), 16)),
        }
        _write(folder, segment, "vehicle_pose", poses)
        if segment.lidars:
            _write(folder, segment, "lidar_calibration", _calibration(segment))
    return folder


def _calibration(segment: Segment) -> dict:
    """Inclinations are least and greatest, or that of each beam."""
    extrinsics, inclinations = zip(*segment.lidars.values(), strict=True)
    beams = [each if len(each) > 2 else None for each in inclinations]
    matrices = [np.ravel(matrix).tolist() for matrix in extrinsics]
    return {
        "key.segment_context_name": pa.array([segment.name] * len(segment.lidars)),
        "key.laser_name": pa.array(list(segment.lidars), pa.int8()),
        f"{CALIBRATION}.extrinsic.transform": pa.array(matrices, pa.list_(pa.float64(), 16)),
        f"{CALIBRATION}.beam_inclination.min": pa.array([float(min(e)) for e in inclinations]),
        f"{CALIBRATION}.beam_inclination.max": pa.array([float(max(e)) for e in inclinations]),
        f"{CALIBRATION}.beam_inclination.values": pa.array(beams, pa.list_(pa.float64())),
    }


def _write(folder: Path, segment: Segment, component: str, columns: dict) -> None:
    path = folder / segment.split / component / f"{segment.name}.parquet"
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.table(columns), path)
