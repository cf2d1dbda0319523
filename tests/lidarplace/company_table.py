"""Label files in a company's manner: a box log under other names, units and origins."""

import math
from dataclasses import dataclass, replace

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
    anchor: str = "centre"
    axes: tuple[str, str, str] = ("forward", "left", "up")
    zero: str = "x"
    sense: str | None = None
    half: bool = False
    heading: str = "yaw"
    origin_yaw: float = 0.0
    coordinates: str = "ego"
    origin: tuple[float, float, float] = (-1.4, 0.0, 0.33)
    rate_hz: float | None = None


DIRECTIONS = {"forward": (1, 0, 0), "left": (0, 1, 0), "up": (0, 0, 1)}
DIRECTIONS |= {"back": (-1, 0, 0), "right": (0, -1, 0), "down": (0, 0, -1)}
POINTS = {"top": (0, 0, 0.5), "bottom": (0, 0, -0.5), "rear left bottom": (-0.5, 0.5, -0.5)}
POINTS |= {"front right": (0.5, -0.5, 0), "rear": (-0.5, 0, 0)}


def turned(points: np.ndarray, yaw: np.ndarray | float) -> np.ndarray:
    """Points (n, 3), turned about z, counter-clockwise."""
    x, y, z = points.T
    return np.stack(
        [np.cos(yaw) * x - np.sin(yaw) * y, np.sin(yaw) * x + np.cos(yaw) * y, z], axis=1
    )


def in_axes(vectors: np.ndarray, axes: tuple[str, str, str]) -> np.ndarray:
    """Components of vectors (n, 3) along the axes of a file."""
    return np.stack([vectors @ DIRECTIONS[name] for name in axes], axis=1)


def _angles(yaw: np.ndarray, manner: Manner) -> np.ndarray:
    """Angles from the axis at yaw 0 to the front, about the upright axis of the file or above."""
    fronts = turned(np.tile([1.0, 0.0, 0.0], (len(yaw), 1)), yaw)
    axis, sign = manner.zero[-1], -1 if manner.zero[0] == "-" else 1
    zero = sign * np.array(DIRECTIONS[manner.axes["xyz".index(axis)]])
    hand = np.linalg.det([DIRECTIONS[a] for a in manner.axes])
    about = hand * np.array(DIRECTIONS[manner.axes[2]])
    if manner.sense is not None:  # seen from above
        about = np.array([0, 0, 1 if manner.sense == "counterclockwise" else -1])
    return np.arctan2(fronts @ np.cross(about, zero), fronts @ zero)


def _heading_columns(yaw: np.ndarray, manner: Manner, name: str) -> dict[str, np.ndarray]:
    """Columns of the fronts of boxes, in the file's axes, from their yaw in ours."""
    if manner.heading == "direction":
        fronts = turned(np.tile([1.0, 0.0, 0.0], (len(yaw), 1)), yaw)
        return dict(zip((f"{name}_dx", f"{name}_dy"), in_axes(fronts, manner.axes).T, strict=False))
    if manner.heading == "quaternion":
        half = _angles(yaw, replace(manner, sense=None)) / 2
        parts = {"w": np.cos(half), "x": 0 * half, "y": 0 * half, "z": np.sin(half)}
        return {f"{name}_q{key}": part for key, part in parts.items()}
    start, next_one = _angles(np.array([0.0, 0.1]), manner)  # linear: whole turns stay
    sign = 1 if math.remainder(next_one - start, 2 * math.pi) > 0 else -1
    return {name: (start + yaw * sign) * ANGLE[manner.angle]}


def write_in_manner(log: BoxLog, manner: Manner) -> pd.DataFrame:
    """The boxes of a log, whose drives are its scenes and whose times start at 0."""
    frames = log.frames.set_index("frame").loc[log.boxes["frame"]].reset_index()
    places = log.boxes[list("xyz")].to_numpy()
    yaw = log.boxes["yaw"].to_numpy()
    sides = log.boxes[["length", "width", "height"]].to_numpy()
    places = places + turned(sides * POINTS.get(manner.anchor, (0, 0, 0)), yaw)
    places, yaw = turned(places - manner.origin, -manner.origin_yaw), yaw - manner.origin_yaw
    size = sides * LENGTH[manner.size] / (2 if manner.half else 1)
    unit = TIME.get(manner.time, 10**6)
    stamp = START_S * unit + (frames["timestamp_s"] * unit)
    stamp = stamp.round().astype(np.int64) if manner.time != "s" else stamp
    if manner.time == "iso":
        stamp = [
            f"{date.isoformat()}+01:00" for date in pd.to_datetime(stamp + 36 * 10**8, unit="us")
        ]
    table = pd.DataFrame(
        {
            "recording": log.boxes["scene"].to_numpy(),
            "stamp": stamp,
            "track": log.boxes["object_id"].to_numpy(),
            "kind": log.boxes["class"].map(CATEGORIES).to_numpy(),
        }
    )
    if manner.coordinates == "world":
        ego_yaw = frames["ego_yaw"].to_numpy()
        ego = np.column_stack([frames[["ego_x", "ego_y"]], np.zeros(len(frames))])
        aside = np.tile([*manner.origin[:2], 0.0], (len(ego), 1))  # heights are the file's own
        host = ego + turned(aside, ego_yaw)
        places, yaw = (
            host + turned(places, ego_yaw + manner.origin_yaw),
            yaw + ego_yaw + manner.origin_yaw,
        )
        table["host_x"], table["host_y"] = in_axes(host, manner.axes)[:, :2].T
        host_yaw = ego_yaw + manner.origin_yaw
        table = table.assign(**_heading_columns(host_yaw, manner, "host_heading"))
    for name, place in zip(("posX", "posY", "posZ"), in_axes(places, manner.axes).T, strict=True):
        table[name] = place * LENGTH[manner.position]
    for name, side in zip(("len", "wid", "hgt"), size.T, strict=True):
        table[name] = side
    return table.assign(**_heading_columns(yaw, manner, "heading"))


def _heading_keys(manner: Manner, name: str) -> dict[str, object]:
    if manner.heading == "quaternion":
        return {"quaternion": {key: f"{name}_q{key}" for key in "xyzw"}}
    if manner.heading == "direction":
        return {"direction": {"x": f"{name}_dx", "y": f"{name}_dy"}}
    return {"yaw": name}


def mapping_of(log: BoxLog, manner: Manner) -> dict[str, object]:
    """The mapping that tells all of this."""
    host = {"x": "host_x", "y": "host_y", **_heading_keys(manner, "host_heading")}
    if manner.zero != "x" or manner.axes != Manner.axes:
        host["zero"] = manner.zero
    keys = "drive time object category x y z length width height"
    names = "recording stamp track kind posX posY posZ len wid hgt"
    mapping = {
        "columns": dict(zip(keys.split(), names.split(), strict=True))
        | _heading_keys(manner, "heading"),
        "units": {key: getattr(manner, key) for key in ("position", "size", "angle", "time")},
        "anchor": manner.anchor,
        "origin": dict(zip("xyz", manner.origin, strict=True)),
        "classes": {theirs: ours for ours, theirs in CATEGORIES.items()},
        "frames": {"rate_hz": manner.rate_hz},
        "drives": {"test": sorted(set(log.frames["scene"][log.frames["split"] == "test"]))},
    }
    if manner != replace(manner, axes=Manner.axes, zero="x", sense=None):
        mapping["axes"] = dict(zip("xyz", manner.axes, strict=True))
        angles = manner.sense and manner.heading == "yaw"
        mapping["yaw"] = {"zero": manner.zero} | ({"sense": manner.sense} if angles else {})
    if manner.half:
        mapping["size"] = "half"
    if manner.origin_yaw:
        mapping["origin"]["yaw"] = manner.origin_yaw
    if manner.coordinates == "world":
        mapping |= {"poses": host, "coordinates": "world"}
    return mapping


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
