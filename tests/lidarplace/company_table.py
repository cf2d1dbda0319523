"""Label files in a company's manner: a box log under other names, units and origins."""

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd

from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import BOX_COLUMNS, POSE_COLUMNS

LENGTH = {"m": 1.0, "cm": 100.0, "mm": 1000.0}
ANGLE = {"rad": 1.0, "deg": 180.0 / math.pi}
TIME = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}
START_S = 1_760_000_000
"""Since 1970, of the first frame of every drive."""
CATEGORIES = {"Car": "passenger_car", "Cyclist": "bicyclist", "Pedestrian": "person"}
RATE_HZ = 10
SIZES = {"Car": (4.4, 1.8, 1.5), "Cyclist": (1.8, 0.6, 1.7), "Pedestrian": (0.6, 0.6, 1.8)}


@dataclass(frozen=True)
class Manner:
    """How the file is written; `origin` is where its own origin is in our ego frame, metres."""

    position: str = "m"
    size: str = "mm"
    angle: str = "deg"
    time: str = "us"
    box_z: str = "centre"
    coordinates: str = "ego"
    origin: tuple[float, float, float] = (-1.4, 0.0, 0.33)
    rate_hz: float | None = None


def write_in_manner(log: BoxLog, manner: Manner) -> pd.DataFrame:
    """The boxes of a log, whose drives are its scenes and whose times start at 0."""
    frames = log.frames.set_index("frame").loc[log.boxes["frame"]].reset_index()
    x, y, z = (log.boxes[axis].to_numpy() - manner.origin[i] for i, axis in enumerate("xyz"))
    yaw = log.boxes["yaw"].to_numpy()
    size = log.boxes[["length", "width", "height"]] * LENGTH[manner.size]
    if manner.box_z == "bottom":
        z = z - log.boxes["height"].to_numpy() / 2
    stamp = START_S * TIME[manner.time] + (frames["timestamp_s"] * TIME[manner.time])
    table = pd.DataFrame(
        {
            "recording": log.boxes["scene"].to_numpy(),
            "stamp": stamp.round().astype(np.int64) if manner.time != "s" else stamp,
            "track": log.boxes["object_id"].to_numpy(),
            "kind": log.boxes["class"].map(CATEGORIES).to_numpy(),
        }
    )
    if manner.coordinates == "world":
        ego_yaw = frames["ego_yaw"].to_numpy()
        cos, sin = np.cos(ego_yaw), np.sin(ego_yaw)
        host_x = frames["ego_x"] + cos * manner.origin[0] - sin * manner.origin[1]
        host_y = frames["ego_y"] + sin * manner.origin[0] + cos * manner.origin[1]
        x, y = host_x + cos * x - sin * y, host_y + sin * x + cos * y
        yaw = yaw + ego_yaw
        table["host_x"], table["host_y"] = host_x, host_y
        table["host_heading"] = ego_yaw * ANGLE[manner.angle]
    for name, place in (("posX", x), ("posY", y), ("posZ", z)):
        table[name] = np.asarray(place) * LENGTH[manner.position]
    for name, side in (("len", "length"), ("wid", "width"), ("hgt", "height")):
        table[name] = size[side].to_numpy()
    table["heading"] = np.asarray(yaw) * ANGLE[manner.angle]
    return table


def mapping_of(log: BoxLog, manner: Manner) -> dict[str, object]:
    """The mapping that tells all of this."""
    poses = {"poses": {"x": "host_x", "y": "host_y", "yaw": "host_heading"}, "coordinates": "world"}
    keys = "drive time object category x y z length width height yaw"
    names = "recording stamp track kind posX posY posZ len wid hgt heading"
    return {
        "columns": dict(zip(keys.split(), names.split(), strict=True)),
        "units": {key: getattr(manner, key) for key in ("position", "size", "angle", "time")},
        "box_z": manner.box_z,
        "origin": dict(zip("xyz", manner.origin, strict=True)),
        "classes": {theirs: ours for ours, theirs in CATEGORIES.items()},
        "frames": {"rate_hz": manner.rate_hz},
        "drives": {"test": sorted(set(log.frames["scene"][log.frames["split"] == "test"]))},
        **(poses if manner.coordinates == "world" else {}),
    }


def traffic(
    seed: int = 0, drives: int = 3, frames: int = 8, objects: int = 6, straight: bool = False
) -> BoxLog:
    """Cars, bicycles and pedestrians that move along their yaw past a vehicle that turns."""
    random = np.random.default_rng(seed)
    boxes, rows = [], []
    for drive in range(drives):
        place = random.uniform(-30, 30, (objects, 2))
        heading = random.uniform(-1, 1, objects) * (0.05 if straight else 3.0)
        speed = random.uniform(2, 12, objects)
        kind = [list(CATEGORIES)[k % 3] for k in range(objects)]
        size = [SIZES[name] for name in kind]
        ego = np.array([100.0 * drive, 7.0])
        ego_yaw = 0.0 if straight else float(random.uniform(-3, 3))
        for n in range(frames):
            number, time = frames * drive + n, n / RATE_HZ
            ego_yaw += 0.0 if straight else 0.02
            ego = ego + 5.0 / RATE_HZ * np.array([math.cos(ego_yaw), math.sin(ego_yaw)])
            rows.append((f"drive {drive}", number, time, drive, *ego, ego_yaw))
            world = np.array([100.0 * drive, 7.0]) + place
            world += (speed * time)[:, None] * np.stack([np.cos(heading), np.sin(heading)], 1)
            cos, sin = math.cos(ego_yaw), math.sin(ego_yaw)
            seen = (world - ego) @ np.array([[cos, -sin], [sin, cos]])
            for k, (x, y) in enumerate(seen):
                length, width, height = size[k]
                yaw = math.remainder(heading[k] - ego_yaw, 2 * math.pi)
                box = (x, y, height / 2, length, width, height, yaw)
                boxes.append((f"drive {drive}", number, time, f"{drive}-{k}", kind[k], *box))
    names = ["scene", "frame", "timestamp_s", "route", *POSE_COLUMNS]
    table = pd.DataFrame(rows, columns=names)
    table["split"] = np.where(table["route"] == drives - 1, "test", "train")
    return BoxLog(pd.DataFrame(boxes, columns=list(BOX_COLUMNS)), table)
