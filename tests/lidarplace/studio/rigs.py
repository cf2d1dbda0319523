"""A file of rigs and a log for the tests of the studio."""

from pathlib import Path

import pandas as pd

from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import BOX_COLUMNS, FRAME_COLUMNS

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


def written(folder: Path, text: str = TEXT) -> Path:
    """The path of a file with that text."""
    path = folder / "rigs.yaml"
    path.write_text(text, encoding="utf-8")
    return path


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
