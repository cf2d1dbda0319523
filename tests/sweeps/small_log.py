"""A box log of three frames to train and one to test, with cars on an open plane; its sweeps."""

from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from lidarplace.logs.box_log import BoxLog, write_box_log
from lidarplace.logs.boxes import GEOMETRY


def write_small_log(folder: Path, seed: int = 0) -> None:
    random = np.random.default_rng(seed)
    rows = [
        ("a", frame, frame / 10, k, "Car", 8 + 7 * k, random.uniform(-6, 6), 0.8, 4.4, 1.8, 1.6, 0)
        for frame in range(4)
        for k in range(4)
    ]
    names = ["scene", "frame", "timestamp_s", "object_id", "class", *GEOMETRY]
    split = ["train", "train", "train", "test"]
    frames = pd.DataFrame({"scene": "a", "frame": range(4), "route": 0, "split": split})
    frames.insert(2, "timestamp_s", frames["frame"] / 10)
    write_box_log(folder, BoxLog(pd.DataFrame(rows, columns=names), frames))


TOWN = {"seed": 3, "density": 30, "pedestrians": 10, "routes": 2, "test_routes": 1}
TOWN |= {"frames_per_route": 4, "frame_stride": 5, "warmup_s": 5}
"""A scene of simulated traffic, short for tests."""


SMALL = {
    "scene": {"source": "log", "folder": "log"},
    "classes": ["Car"],
    "lidar": {"azimuth_steps": 360},
    "surrogate": {"resolution": 0.8, "accuracy": False, "sampling_error": False},
    "training": {"epochs": 1, "batch_size": 2},
    "output": "runs",
    "ray": "debug",
}
"""A sweep on the log, in the folder in which the command is given."""


def write_sweep(folder: Path, file: str = "grid.yaml", /, **keys: object) -> Path:
    """The small sweep, from anywhere, with other keys; its log is written if it is not there."""
    if not (folder / "log").exists():
        write_small_log(folder / "log")
    scene = {"source": "log", "folder": str(folder / "log")}
    own = {"scene": scene, "output": str(folder / "runs")}
    (folder / file).write_text(yaml.safe_dump(SMALL | own | keys))
    return folder / file
