"""A box log of four classes, two of them no class of KITTI: cars, trucks, scooters, pedestrians."""

from pathlib import Path

import numpy as np
import pandas as pd

from lidarplace.logs.box_log import BoxLog, write_box_log
from lidarplace.logs.boxes import GEOMETRY

CLASSES = ("Car", "Truck", "Scooter", "Pedestrian")
SIZES = {"Car": (4.4, 1.8, 1.6), "Truck": (7.5, 2.5, 3.2)}
SIZES |= {"Scooter": (1.8, 0.7, 1.4), "Pedestrian": (0.6, 0.6, 1.75)}


def write_four_classes(folder: Path, frames: int = 4, routes: int = 4, seed: int = 0) -> BoxLog:
    """Routes of so many frames, the last two of which are test; two objects of a class in each."""
    random = np.random.default_rng(seed)
    rows = []
    for route in range(routes):
        for index, name in enumerate(CLASSES * 2):
            length, width, height = np.array(SIZES[name]) * random.uniform(0.9, 1.1)
            x, y = 4 + 4 * index, random.uniform(-6, 6)
            for k in range(frames):
                pose = (x + 0.4 * k, y, height / 2, length, width, height, 0.0)
                frame = route * frames + k
                rows.append((f"r{route}", frame, frame / 2, f"{name}-{route}-{index}", name, *pose))
    names = ["scene", "frame", "timestamp_s", "object_id", "class", *GEOMETRY]
    number = np.arange(routes * frames)
    route = number // frames
    split = np.where(route < routes - 2, "train", "test")
    table = pd.DataFrame({"frame": number, "timestamp_s": number / 2, "route": route})
    table = table.assign(scene=[f"r{own}" for own in route], split=split)
    log = BoxLog(pd.DataFrame(rows, columns=names), table)
    write_box_log(folder, log)
    return log
