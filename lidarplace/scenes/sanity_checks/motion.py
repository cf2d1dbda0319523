"""Do vehicles move where they head? They rarely slide: it shows what a yaw means."""

import math
from collections.abc import Iterator
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import POSE_COLUMNS
from lidarplace.scenes.sanity_checks.doubt import Doubt

STEP_M = 0.2  # shorter steps from frame to frame say more of the labels' noise than of motion
MOST_STEPS = 20_000
LEAST_STEPS = 20  # steps of vehicles that are needed to compare yaw with motion
ACROSS = 0.3
"""Sine of the angle between motion and length axis, 17 degrees, above which a step is across."""
MOST_ACROSS = 0.1
"""Share of steps that are across without a doubt: labels jitter, and cars in car parks turn."""
MOST_OFF = 0.5
"""Share of steps in which the vehicle itself may drive another way than it heads: it reverses."""
CLEARLY = 4  # so many times fewer are across in the unit that is meant
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


class Steps(NamedTuple):
    """Objects from one frame to the next, shape (steps,)."""

    sine: NDArray[np.float64]  # |sine| of the angle between motion and length axis
    box: NDArray[np.int64]  # the box at the end of the step, by its place in the log


def steps_across(log: BoxLog, factor: float = 1.0, of_world: bool = False) -> Steps:
    """Steps of the vehicles of a log (pedestrians step aside), their yaw taken `factor` times. With
    `of_world` it is the angle in the world that is taken so, the vehicle's own being right. Where
    the log has poses, motion is that in the world; elsewhere see `_beside_the_vehicle`."""
    steps = _steps(log)
    if len(steps) > MOST_STEPS:  # whole frames, spread over the log
        number = steps["frame"].rank(method="dense").astype(int)
        steps = steps[number % (len(steps) // MOST_STEPS + 1) == 0]
    if _has_poses(log):
        length, across, enough = _in_the_world(steps, factor, of_world)
    else:
        length, across, enough = _beside_the_vehicle(steps, factor)
    moved = enough & (length > STEP_M)
    return Steps(across[moved] / length[moved], steps["row"].to_numpy(np.int64)[moved])


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


Motion = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]
"""Length of each step, how much of it is across the length axis, and whether that is known."""


def _in_the_world(steps: pd.DataFrame, factor: float, of_world: bool) -> Motion:
    def place(prefix: str) -> NDArray[np.float64]:
        x, y, ego_x, ego_y, ego_yaw = _columns(steps, prefix, "x", "y", *POSE_COLUMNS)
        cos, sin = np.cos(ego_yaw), np.sin(ego_yaw)
        return np.stack([ego_x + cos * x - sin * y, ego_y + sin * x + cos * y])

    step = place("") - place("before_")
    yaw, ego_yaw = _columns(steps, "", "yaw", "ego_yaw")
    yaw = factor * (yaw + ego_yaw) if of_world else factor * yaw + ego_yaw
    across = np.abs(np.cos(yaw) * step[1] - np.sin(yaw) * step[0])
    return np.hypot(*step), across, np.ones(len(steps), bool)


def _beside_the_vehicle(steps: pd.DataFrame, factor: float) -> Motion:
    """By the motion of the vehicle, v ahead and w to the left, under which objects slide least.
    `n·(d + v e_x + w e_z × p) = 0` by least squares in each frame, n the normal of an object's
    length axis, d its step and p its place in the ego frame. Needs over two objects in a frame."""
    x, y, yaw = _columns(steps, "", "x", "y", "yaw")
    before_x, before_y = _columns(steps, "before_", "x", "y")
    dx, dy = x - before_x, y - before_y
    cos, sin = np.cos(factor * yaw), np.sin(factor * yaw)
    slide = cos * dy - sin * dx
    by_motion = np.stack([-sin, sin * y + cos * x], axis=1)
    across, enough = np.zeros(len(steps)), np.zeros(len(steps), bool)
    for rows in steps.reset_index(drop=True).groupby("frame").indices.values():
        if len(rows) > UNKNOWNS:
            motion = np.linalg.lstsq(by_motion[rows], -slide[rows])[0]
            left = np.abs(slide[rows] + by_motion[rows] @ motion)
            across[rows] = left * np.sqrt(len(rows) / (len(rows) - UNKNOWNS))
            enough[rows] = True
    return np.hypot(dx, dy), across, enough


def _columns(steps: pd.DataFrame, prefix: str, *names: str) -> NDArray[np.float64]:
    return steps[[prefix + name for name in names]].to_numpy(np.float64).T
