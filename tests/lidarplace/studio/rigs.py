"""A file of rigs, a log and a studio of both for its tests."""

from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from lidarplace import Roi
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import BOX_COLUMNS, FRAME_COLUMNS
from lidarplace.studio.rigs_file import read_rigs
from lidarplace.studio.studio import Studio

ROI = Roi((-16, 16), (-8, 8), (0, 4), 0.4)

TEXT = """\
lidar: {beams: 8, elevation_deg: [-25, 5], azimuth_steps: 720}
prices: {vlp16: 4}
placements:
  roof:
    mounts:
      - {x: 0.1, y: 0.6, z: 1.8, roll: 0.28, yaw_deg: 12.5}
      - {x: 0.0, y: -0.6, z: 1.8}
  left handed:
    convention: carla
    mounts:
      - {y: 0.5, z: 2.0, pitch: 0.1, lidar: vlp16}
zones:
  roof: {x: [-1, 1], y: [-0.7, 0.7], z: [1.6, 2.0], standoff: 0.5}
constraints: {distance: 0.2}
"""


def written(folder: Path, content: str | dict[str, Any] = TEXT) -> Path:
    """The path of a file with that content."""
    path = folder / "rigs.yaml"
    text = content if isinstance(content, str) else yaml.safe_dump(content, sort_keys=False)
    path.write_text(text, encoding="utf-8")
    return path


def studio_of(
    folder: Path, content: str | dict[str, Any] = TEXT, *cars: tuple[float, float]
) -> Studio:
    """A studio of a file with that content, and of a log of one frame with these cars."""
    return Studio(read_rigs(written(folder, content)), log_of([*cars] or [(8.0, 1.0)], 1), ROI)


def log_of(cars: list[tuple[float, float]], frames: int = 3) -> BoxLog:
    """Cars, x and y in metres, that are 0.7 m farther in each frame."""
    listed = pd.DataFrame({"scene": "a", "frame": range(frames), "route": 0, "split": "train"})
    listed["timestamp_s"] = listed["frame"] / 10
    table = pd.DataFrame(cars, columns=["x", "y"]).assign(
        object_id=[f"car {n}" for n in range(len(cars))],
        length=4.2, width=1.8, height=1.6, yaw=0.0, z=0.8,
    )  # fmt: skip
    table["class"] = "Car"
    boxes = listed[["scene", "frame", "timestamp_s"]].merge(table, how="cross")
    boxes["x"] += 0.7 * boxes["frame"]
    return BoxLog(boxes[list(BOX_COLUMNS)], listed[list(FRAME_COLUMNS)])
