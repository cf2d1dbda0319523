"""Do vehicles move where they head? They rarely slide: it shows what a yaw means."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import POSE_COLUMNS
from lidarplace.scenes.sanity_checks.doubt import Doubt

STEP_M = 0.2
"""Shorter steps from frame to frame say more of the labels' noise than of motion."""
MOST_STEPS = 20_000
LEAST_STEPS = 20
"""Steps of vehicles that are needed to compare yaw with motion."""
ACROSS = 0.3
"""Sine of the angle between motion and length axis, 17 degrees, above which a step is across."""
MOST_ACROSS = 0.1
"""Share of steps that are across without a doubt: labels jitter, and cars in car parks turn."""
MOST_OFF = 0.5
"""Share of steps in which the vehicle itself may drive another way than it heads: it reverses."""
CLEARLY = 4
"""So many times fewer are across in the unit that is meant."""
UNKNOWNS = 2
"""Of the vehicle's own motion in a frame: how far ahead, and by which angle to the left."""


def doubts_of_motion(log: BoxLog, angle: Literal["rad", "deg"]) -> Iterator[Doubt]:
    """Doubt whether yaw was in this unit: in the other one far fewer vehicles slide."""
    steps = steps_across(log)
    across = steps.sine > ACROSS
    if len(across) < LEAST_STEPS or across.mean() < MOST_ACROSS:
        return
    factor, unit = (math.pi / 180, "deg") if angle == "rad" else (180 / math.pi, "rad")
    other = min(
        (steps_across(log, factor, of_world).sine > ACROSS).mean() for of_world in (False, True)
    )
    if other < across.mean() / CLEARLY:
        boxes = np.zeros(len(log.boxes), bool)
        boxes[steps.box[across]] = True
        why = (
            f"vehicles move across their length axis in {across.mean():.0%} of {len(across):,} "
            f"steps, with yaw in {unit} in {other:.0%}"
        )
        yield Doubt("yaw", "yaw", boxes, why, f"units.angle: {unit}")


def doubts_of_poses(log: BoxLog) -> Iterator[Doubt]:
    """Doubt the heading of the vehicle if it mostly drives another way."""
    if not _has_poses(log):
        return
    frames = log.frames.sort_values(["scene", "frame"])
    dx, dy = (frames.groupby("scene")[axis].diff() for axis in POSE_COLUMNS[:2])
    ahead = np.cos(frames["ego_yaw"]) * dx + np.sin(frames["ego_yaw"]) * dy
    length = np.hypot(dx, dy)
    moved = length > STEP_M
    off = moved & (ahead < math.sqrt(1 - ACROSS**2) * length)
    if moved.sum() >= LEAST_STEPS and off.sum() > MOST_OFF * moved.sum():
        why = (
            f"the vehicle drives another way than it heads in {off.sum() / moved.sum():.0%} of "
            f"{moved.sum():,} steps"
        )
        remedy = "poses.angle, or poses.yaw, which is from the x axis towards y,"
        yield Doubt("poses", "ego_yaw", off[log.frames.index].to_numpy(bool), why, remedy)


@dataclass(frozen=True)
class Steps:
    """Objects from one frame to the next.

    Attributes:
        sine: |sine| of the angle between motion and length axis, shape (steps,).
        box: the box at the end of the step, by its place in the log, shape (steps,).
    """

    sine: NDArray[np.float64]
    box: NDArray[np.int64]


def steps_across(log: BoxLog, factor: float = 1.0, of_world: bool = False) -> Steps:
    """Steps of the vehicles of a log (pedestrians step aside), their yaw taken `factor` times.

    With `of_world` it is the angle in the world that is taken so, the vehicle's own being right.
    Where the log has poses, motion is that in the world. Where it has none, each frame's own
    motion of the vehicle, v ahead and w to the left, is that under which objects slide least:
    `n·(d + v e_x + w e_z × p) = 0` by least squares, n the normal of an object's length axis,
    d its step and p its place in the ego frame. It needs more than two objects in a frame.
    """
    steps = _steps(log)
    if len(steps) > MOST_STEPS:  # whole frames, spread over the log
        number = steps["frame"].rank(method="dense").astype(int)
        steps = steps[number % (len(steps) // MOST_STEPS + 1) == 0]
    if _has_poses(log):
        sine, moved = _in_the_world(steps, factor, of_world)
    else:
        sine, moved = _beside_the_vehicle(steps, factor)
    return Steps(sine[moved], steps["row"].to_numpy(np.int64)[moved])


def _has_poses(log: BoxLog) -> bool:
    known = set(POSE_COLUMNS) <= set(log.frames.columns)
    return known and bool(log.frames["ego_yaw"].notna().all())


def _steps(log: BoxLog) -> pd.DataFrame:
    """Boxes of an object in a frame and the one before it; `before_…` are the earlier values."""
    order = log.frames.sort_values(["scene", "frame"])
    order["place"] = np.arange(len(order))
    poses = [name for name in POSE_COLUMNS if name in order]
    vehicles = log.boxes[["scene", "frame", "object_id", "x", "y", "yaw"]].assign(
        row=np.arange(len(log.boxes))
    )[(log.boxes["class"] != "Pedestrian").to_numpy()]
    table = vehicles.merge(order[["frame", "place", *poses]], on="frame")
    table = table.sort_values(["scene", "object_id", "place"], ignore_index=True)
    before = table.shift(1)
    follows = (
        (table["scene"] == before["scene"])
        & (table["object_id"] == before["object_id"])
        & (table["place"] == before["place"] + 1)
    )
    return table.join(before[["x", "y", *poses]].add_prefix("before_"))[follows]


def _in_the_world(
    steps: pd.DataFrame, factor: float, of_world: bool
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    def place(prefix: str) -> NDArray[np.float64]:
        x, y, ego_x, ego_y, ego_yaw = (
            steps[prefix + name].to_numpy(np.float64) for name in ("x", "y", *POSE_COLUMNS)
        )
        cos, sin = np.cos(ego_yaw), np.sin(ego_yaw)
        return np.stack([ego_x + cos * x - sin * y, ego_y + sin * x + cos * y])

    step = place("") - place("before_")
    yaw, ego_yaw = (steps[name].to_numpy(np.float64) for name in ("yaw", "ego_yaw"))
    yaw = factor * (yaw + ego_yaw) if of_world else factor * yaw + ego_yaw
    length = np.hypot(*step)
    across = np.abs(np.cos(yaw) * step[1] - np.sin(yaw) * step[0])
    return across / np.maximum(length, STEP_M), length > STEP_M


def _beside_the_vehicle(
    steps: pd.DataFrame, factor: float
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    x, y, before_x, before_y = (
        steps[name].to_numpy(np.float64) for name in ("x", "y", "before_x", "before_y")
    )
    dx, dy = x - before_x, y - before_y
    yaw = factor * steps["yaw"].to_numpy(np.float64)
    cos, sin = np.cos(yaw), np.sin(yaw)
    slide = cos * dy - sin * dx
    by_motion = np.stack([-sin, sin * y + cos * x], axis=1)
    across, enough = np.zeros(len(steps)), np.zeros(len(steps), bool)
    for rows in steps.reset_index(drop=True).groupby("frame").indices.values():
        if len(rows) > UNKNOWNS:
            motion = np.linalg.lstsq(by_motion[rows], -slide[rows])[0]
            left = np.abs(slide[rows] + by_motion[rows] @ motion)
            across[rows] = left * np.sqrt(len(rows) / (len(rows) - UNKNOWNS))
            enough[rows] = True
    length = np.hypot(dx, dy)
    return across / np.maximum(length, STEP_M), enough & (length > STEP_M)
