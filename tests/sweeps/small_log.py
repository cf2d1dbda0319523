"""A box log of three frames to train and one to test, with cars on an open plane."""

from pathlib import Path

import numpy as np
import pandas as pd

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
