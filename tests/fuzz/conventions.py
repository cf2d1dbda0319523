"""Box logs in conventions that are not ours: units, axes, order, frames and copies."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd

from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import POSE_COLUMNS, SIZE
from tests.lidarplace.company_table import traffic

Change = Callable[[BoxLog], BoxLog]
PLACE = list("xyz")
EVERY = [*PLACE, *SIZE]


def right_log(seed: int) -> BoxLog:
    """Traffic of which nothing drives through the vehicle."""
    log = traffic(seed, drives=4, frames=10, objects=12)
    near = np.hypot(log.boxes["x"], log.boxes["y"]) < 4
    apart = ~log.boxes["object_id"].isin(log.boxes["object_id"][near])
    return replace(log, boxes=log.boxes[apart].reset_index(drop=True))


def boxes(change: Callable[[pd.DataFrame], dict[str, object]], log: BoxLog) -> BoxLog:
    return replace(log, boxes=log.boxes.assign(**change(log.boxes)))


def frames(change: Callable[[pd.DataFrame], dict[str, object]], log: BoxLog) -> BoxLog:
    return replace(log, frames=log.frames.assign(**change(log.frames)))


def scaled(factor: float, *names: str) -> Change:
    return partial(boxes, lambda table: {name: table[name] * factor for name in names})


def permuted(*names: str) -> Change:
    return partial(boxes, lambda table: dict(zip(SIZE, map(table.get, names), strict=True)))


def in_world(place: bool, shift: bool, yaw: bool, log: BoxLog) -> BoxLog:
    """Boxes in the world's frame, or with its axes, or its yaw."""
    at = log.frames.set_index("frame").loc[log.boxes["frame"]]
    ego_x, ego_y, ego_yaw = (at[name].to_numpy() for name in POSE_COLUMNS)
    x, y = (log.boxes[name].to_numpy() for name in "xy")
    if place:
        cos, sin = np.cos(ego_yaw), np.sin(ego_yaw)
        x, y = cos * x - sin * y + ego_x * shift, sin * x + cos * y + ego_y * shift
    return boxes(lambda b: {"x": x, "y": y, "yaw": b["yaw"] + ego_yaw * yaw}, log)


def copied_route(log: BoxLog) -> BoxLog:
    """Log with a test route that is the first one."""
    first = log.frames["route"] == 0
    in_first = log.boxes["frame"].isin(log.frames["frame"][first])
    tables = (log.frames[first].assign(route=99, split="test"), log.boxes[in_first])
    more = [table.assign(frame=table["frame"] + 1000, scene="copy") for table in tables]
    return replace(
        log,
        frames=pd.concat([log.frames, more[0]], ignore_index=True),
        boxes=pd.concat([log.boxes, more[1]], ignore_index=True),
    )


def one_off(log: BoxLog) -> BoxLog:
    """Boxes in the frame after theirs."""
    later = boxes(lambda table: {"frame": table["frame"] + 1}, log)
    in_log = later.boxes["frame"].isin(log.frames["frame"])
    return replace(later, boxes=later.boxes[in_log].reset_index(drop=True))


def twice(log: BoxLog) -> BoxLog:
    again = log.boxes.assign(object_id=log.boxes["object_id"] + "b")
    return replace(log, boxes=pd.concat([log.boxes, again], ignore_index=True))


CLASSES = {"Car": "Pedestrian", "Pedestrian": "Cyclist", "Cyclist": "Car"}
CONVENTIONS: dict[str, Change] = {
    "sizes in mm": scaled(1000, *SIZE),
    "sizes in cm": scaled(100, *SIZE),
    "sizes in feet": scaled(3.28, *SIZE),
    "half sizes": scaled(0.5, *SIZE),
    "double sizes": scaled(2, *SIZE),
    "places in mm": scaled(1000, *PLACE),
    "places in feet": scaled(3.28, *PLACE),
    "all in mm": scaled(1000, *EVERY),
    "all in cm": scaled(100, *EVERY),
    "all in feet": scaled(3.28, *EVERY),
    "yaw in degrees": scaled(180 / np.pi, "yaw"),
    "yaw made radians twice": scaled(np.pi / 180, "yaw"),
    "yaw clockwise": scaled(-1, "yaw"),
    "yaw + 90": partial(boxes, lambda b: {"yaw": b["yaw"] + np.pi / 2}),
    "yaw - 90": partial(boxes, lambda b: {"yaw": b["yaw"] - np.pi / 2}),
    "compass": partial(boxes, lambda b: {"yaw": np.pi / 2 - b["yaw"]}),
    "y mirrored": scaled(-1, "y"),
    "x mirrored": scaled(-1, "x"),
    "x and y swapped": partial(boxes, lambda b: {"x": b["y"], "y": b["x"]}),
    "y ahead": partial(boxes, lambda b: {"x": -b["y"], "y": b["x"]}),
    "length and width swapped": permuted("width", "length", "height"),
    "height, width, length": permuted("height", "width", "length"),
    "z at the bottom": partial(boxes, lambda b: {"z": b["z"] - b["height"] / 2}),
    "z at the top": partial(boxes, lambda b: {"z": b["z"] + b["height"] / 2}),
    "z of a LiDAR": partial(boxes, lambda b: {"z": b["z"] - 1.8}),
    "classes permuted": partial(boxes, lambda b: {"class": b["class"].map(CLASSES)}),
    "all twice": twice,
    "a copied route": copied_route,
    "time in ms": partial(frames, lambda f: {"timestamp_s": f["timestamp_s"] * 1e3}),
    "time in ks": partial(frames, lambda f: {"timestamp_s": f["timestamp_s"] / 1e3}),
}
"""Those that boxes alone show."""
OF_TIME: dict[str, Change] = {
    "time backwards": partial(frames, lambda f: {"timestamp_s": 9 - f["timestamp_s"]}),
    "frames off by one": one_off,
}
"""Those that a label file cannot have, whose frames are its times."""
WITH_POSES: dict[str, Change] = {
    "yaw + 180": partial(boxes, lambda b: {"yaw": b["yaw"] + np.pi}),
    "y and yaw mirrored": scaled(-1, "y", "yaw"),
    "turned by 180": scaled(-1, "x", "y"),
    "all of the world": partial(in_world, True, True, True),
    "places of the world": partial(in_world, True, True, False),
    "axes of the world": partial(in_world, True, False, True),
    "yaw of the world": partial(in_world, False, False, True),
    "poses in degrees": partial(frames, lambda f: {"ego_yaw": np.degrees(f["ego_yaw"])}),
    "poses mirrored": partial(frames, lambda f: {"ego_yaw": -f["ego_yaw"]}),
    "poses swapped": partial(frames, lambda f: {"ego_x": f["ego_y"], "ego_y": f["ego_x"]}),
    "poses in mm": partial(frames, lambda f: {n: f[n] * 1e3 for n in POSE_COLUMNS[:2]}),
}
"""Those that only the poses of the vehicle show."""
