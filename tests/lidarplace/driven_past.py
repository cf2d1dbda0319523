"""A log of a car that drives past parked ones, at known places of the world."""

import math

import pandas as pd

from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import GEOMETRY

POSES = [
    (-90.0, 0.0, 2.0, 0.0, 0.0, 0.1),
    (25.0, 2.0, 2.5, 0.02, -0.05, 0.4),
    (50.0, 1.0, 3.0, 0, 0, -3),
]


def driven_past(poses) -> BoxLog:
    """A log of a car that drives past two parked ones at known places of the world.

    `poses`: x, y, z, roll, pitch, yaw of the recording vehicle by frame."""
    parked = {"A": (30.0, 10.0, 0.75, 0.3), "B": (40.0, -5.0, 0.75, -2.0)}
    boxes, frames = [], []
    for frame, (x, y, z, roll, pitch, yaw) in enumerate(poses):
        place = {"scene": "s", "frame": frame, "timestamp_s": frame / 10}
        pose = {"ego_x": x, "ego_y": y, "ego_yaw": yaw, "ego_z": z}
        pose |= {"ego_roll": roll, "ego_pitch": pitch}
        frames.append(place | {"route": 0, "split": "train"} | pose)
        # World to ego by its inverse: one elementary turn after the other.
        for name, (wx, wy, wz, heading) in parked.items():
            u, v, w = wx - x, wy - y, wz - z
            u, v = u * math.cos(yaw) + v * math.sin(yaw), v * math.cos(yaw) - u * math.sin(yaw)
            u, w = (
                u * math.cos(pitch) - w * math.sin(pitch),
                u * math.sin(pitch) + w * math.cos(pitch),
            )
            v, w = v * math.cos(roll) + w * math.sin(roll), w * math.cos(roll) - v * math.sin(roll)
            of_box = dict(zip(GEOMETRY, (u, v, w, 4.0, 2.0, 1.5, heading - yaw), strict=True))
            boxes.append(place | {"object_id": name, "class": "Car"} | of_box)
    return BoxLog(pd.DataFrame(boxes), pd.DataFrame(frames))
