"""Times and motion that look wrong: vehicles rarely slide, which shows the convention of boxes."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.number_text import percent
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import POSE_COLUMNS
from lidarplace.logs.convention import OUR_AXES, Axis, Convention
from lidarplace.logs.plausibility import STEP_S, ImplausibleValue
from lidarplace.scenes.sanity_checks.boxes import LEAST_BOXES
from lidarplace.scenes.sanity_checks.conventions import (
    CLOCKWISE,
    OURS,
    SEEN_FROM_THE_VEHICLE,
    SEEN_IN_THE_WORLD,
    Alternative,
)

MOST_SPEED = 100.0  # metres a second, 360 km/h, of the vehicle in the median
MOST_STEP_M = 150.0  # of the vehicle from one frame to the next in the median, if time is unknown
STEP_M = 0.2  # shorter steps from frame to frame say more of the labels' noise than of motion
MOST_BOXES = 20_000  # of a larger log some runs of frames are enough
RUN = 8  # steps
STRIDE_S = 0.3  # at least so long is a step, of several frames: labels jitter from one to the next
LEAST_STEPS = 20  # steps of vehicles that are needed to compare yaw with motion
LEAST_VEHICLES = 3  # that slide: one may be towed, or labelled in its own way
ACROSS = 0.3
"""Sine of the angle between motion and length axis, 17 degrees, above which a step is across."""
MOST_ACROSS = 0.1
"""Share of steps that may be across: labels jitter, and cars in car parks turn."""
CERTAIN_ACROSS, CERTAIN_STEPS = 0.3, 100  # share across, of so many, of no traffic that is right
MOST_ASIDE = 0.8  # share of the way of boxes past the vehicle that may be from side to side
LEAST_PASSING = 10  # steps past the vehicle that show its axes
MOST_OFF = 0.5
"""Share of steps in which the vehicle itself may drive another way than it heads: it reverses."""
BACKWARDS = 0.8  # share of steps against the heading that no traffic has
CLEARLY = 4  # so many times fewer are across in the convention that is meant
MORE = 1.2  # so many times more vehicles move at most: one that sets parked ones in motion is wrong
UNKNOWNS = 2
"""Unknowns of the vehicle's motion in a frame: how far ahead, and by which angle to the left."""


def implausible_times(log: BoxLog) -> Iterator[ImplausibleValue]:
    """Check the time from frame to frame, and how far the vehicle moves in it."""
    frames = log.frames.sort_values(["scene", "route", "frame"])
    route = frames.groupby(["scene", "route"], sort=False)
    step = route["timestamp_s"].diff()
    if (back := (step < 0)).any():
        problem = f"time goes back from one frame to the next, to {step.min():g} s"
        rows, remedy = back[log.frames.index].to_numpy(bool), "columns.time or columns.frame"
        yield ImplausibleValue("time", "timestamp_s", problem, remedy, False, rows)
        return
    filled = frames["frame"].isin(log.boxes["frame"])
    labelled = frames[filled].groupby(["scene", "route"], sort=False)["timestamp_s"].diff()
    if (median := labelled.median()) < STEP_S[0] or median > STEP_S[1]:
        problem = f"from one frame with boxes to the next it is {median:g} s in the median"
        rows, remedy = filled[log.frames.index].to_numpy(bool), "units.time, or frames.rate_hz"
        certain = bool(labelled.notna().sum() >= LEAST_BOXES)
        yield ImplausibleValue("time", "timestamp_s", problem, remedy, certain, rows)
    if not {*POSE_COLUMNS} <= {*frames.columns}:
        return
    dx, dy = (route[axis].diff() for axis in POSE_COLUMNS[:2])
    length = pd.Series(np.hypot(dx, dy), dx.index)
    for value, most, unit in (
        (length[step > 0] / step[step > 0], MOST_SPEED, "m/s"),
        (length, MOST_STEP_M, "m a frame"),
    ):
        if (median := value.median()) > most:
            problem = f"the vehicle moves by {median:.0f} {unit} in the median"
            rows = (length[log.frames.index] > 0).to_numpy(bool)
            certain = bool(value.notna().sum() >= LEAST_BOXES)
            remedy = "poses.position, poses.file or units.time"
            yield ImplausibleValue("poses", POSE_COLUMNS[0], problem, remedy, certain, rows)
            return


def implausible_motion(log: BoxLog) -> Iterator[ImplausibleValue]:
    """Check the convention of the boxes: it is wrong if in another one far fewer vehicles slide."""
    pairs = _pairs(log)
    if _has_poses(log):
        steps = [_steps_by_poses(pairs, each) for each in (OURS, *SEEN_IN_THE_WORLD)]
        yield from _compare_conventions(log, steps, SEEN_IN_THE_WORLD)
        return
    steps = [_steps_without_poses(pairs, each) for each in (OURS, *SEEN_FROM_THE_VEHICLE)]
    if implausible := [*_compare_conventions(log, steps, SEEN_FROM_THE_VEHICLE)]:
        yield from implausible
        return
    # The motion that was fitted for the vehicle may make up for a mirrored yaw. If all slide unless
    # it moves, and none slides next to one that stands and yaw clockwise, it stands.
    standing = [_steps_without_poses(pairs, each, stands=True) for each in (OURS, CLOCKWISE)]
    if (standing[1].sine > ACROSS).sum() < MOST_ACROSS / CLEARLY * len(standing[1].sine):
        yield from _compare_conventions(log, standing, (CLOCKWISE,))


def axes_along_motion(log: BoxLog) -> tuple[tuple[Axis, Axis, Axis], float, int]:
    """Return the axes that motion shows: those along which the vehicle, or boxes past it, move.

    Returns directions of x, y and z, with the share of the way along the forward one, and the
    number of steps: of the vehicle if poses are known. Otherwise traffic passes along the vehicle,
    backwards as most of it stands, and it is farther ahead and behind than aside, else the share is
    0; what is left or right does not show."""
    places = np.abs(log.boxes[["x", "y"]].to_numpy(np.float64))
    if _has_poses(log):
        frames = log.frames.sort_values(["scene", "frame"])
        dx, dy = (frames.groupby("scene")[axis].diff().to_numpy() for axis in POSE_COLUMNS[:2])
        cos, sin = np.cos(frames["ego_yaw"]), np.sin(frames["ego_yaw"])
        steps = np.stack([cos * dx + sin * dy, cos * dy - sin * dx], axis=1)
    else:
        pairs = _pairs(log)
        steps = -(_place(pairs, "", OURS) - _place(pairs, "before_", OURS)).T
    steps = steps[np.hypot(*steps.T) > STEP_M]
    way = np.abs(steps).sum(axis=0)
    along = int(way[1] > way[0])
    share = float(way[along] / way.sum()) if len(steps) else 0.0
    if len(places) and not _has_poses(log) and np.median(places, axis=0).argmax() != along:
        share = 0.0
    back = bool((steps[:, along] < 0).mean() > BACKWARDS) if len(steps) else False
    return _AXES_ALONG[along][back], share, len(steps)


_AXES_ALONG: tuple[tuple[tuple[Axis, Axis, Axis], ...], ...] = (
    (OUR_AXES, ("back", "right", "up")),
    (("right", "forward", "up"), ("left", "back", "up")),
)
"""Axes of which x, or y, is along the motion; or against it."""


def implausible_axes(log: BoxLog) -> Iterator[ImplausibleValue]:
    """Check that traffic passes along the vehicle rather than from side to side."""
    if _has_poses(log):
        return  # `implausible_poses` compares these with the vehicle's motion
    axes, share, steps = axes_along_motion(log)
    if axes[1] in ("forward", "back") and share > MOST_ASIDE and steps >= LEAST_PASSING:
        problem = f"boxes move along y in {percent(share)} of their way, as if y were ahead"
        rows = np.ones(len(log.boxes), bool)
        convention = Convention.of(axes)
        remedy = f"axes (y {axes[1]})"
        yield ImplausibleValue("axes", "y", problem, remedy, False, rows, convention)


def shares_across(
    log: BoxLog, conventions: Sequence[Convention]
) -> tuple[list[float], list[float], int]:
    """Return the share of steps across the length axis in each convention, and against the front.

    With the number of steps in the first one; conventions are of the numbers of the log."""
    pairs, of_pairs = _pairs(log), _steps_by_poses if _has_poses(log) else _steps_without_poses
    steps = [of_pairs(pairs, Alternative("", "", convention)) for convention in conventions]
    across = [float((each.sine > ACROSS).mean()) if len(each.sine) else 1.0 for each in steps]
    back = [float(each.back.mean()) if len(each.back) else 0.0 for each in steps]
    return across, back, len(steps[0].sine)


def implausible_poses(log: BoxLog) -> Iterator[ImplausibleValue]:
    """Check that the vehicle mostly drives where it heads."""
    if not _has_poses(log):
        return
    frames = log.frames.sort_values(["scene", "frame"])
    dx, dy = (frames.groupby("scene")[axis].diff() for axis in POSE_COLUMNS[:2])
    ahead = np.cos(frames["ego_yaw"]) * dx + np.sin(frames["ego_yaw"]) * dy
    length = np.hypot(dx, dy)
    moved = length > STEP_M
    off = moved & (ahead < math.sqrt(1 - ACROSS**2) * length)
    if moved.sum() >= LEAST_STEPS and off.sum() > MOST_OFF * moved.sum():
        problem = (
            f"the vehicle drives another way than it heads in {percent(off.sum() / moved.sum())} "
            f"of {moved.sum():,} steps"
        )
        remedy = "poses.angle, or poses.yaw (from the x axis towards y)"
        rows, certain = off[log.frames.index].to_numpy(bool), bool(moved.sum() >= CERTAIN_STEPS)
        yield ImplausibleValue("poses", "ego_yaw", problem, remedy, certain, rows)


class Steps(NamedTuple):
    """Vehicles from one frame to the next, shape (steps,)."""

    sine: NDArray[np.float64]  # |sine| of the angle between motion and length axis
    back: NDArray[np.bool_]  # whether the motion is against the heading
    box: NDArray[np.int64]  # the box at the end of the step, by its place in the log


def _compare_conventions(
    log: BoxLog, steps: list[Steps], others: tuple[Alternative, ...]
) -> Iterator[ImplausibleValue]:
    """Reject the first of `steps`, ours, if those of another convention are far fewer across."""
    ours, across = steps[0], steps[0].sine > ACROSS
    if len(across) < LEAST_STEPS:
        return
    if across.mean() < MOST_ACROSS:
        if ours.back.mean() > BACKWARDS:
            problem = f"vehicles move against their heading in {percent(ours.back.mean())} of "
            problem += f"{len(across):,} steps"
            behind = Convention.of(zero="-x")
            yield from _sliding(log, ours, ours.back, problem, "yaw by half a turn", behind)
        return
    shares = [
        (each.sine > ACROSS).mean() if LEAST_STEPS <= len(each.sine) <= MORE * len(across) else 1.0
        for each in steps[1:]
    ]
    best = int(np.argmin(shares))
    if shares[best] < across.mean() / CLEARLY:
        problem = (
            f"vehicles move across their length axis in {percent(across.mean())} of "
            f"{len(across):,} steps, with {others[best].meaning} in {percent(shares[best])}"
        )
        other = others[best]
        convention = other.convention if other.is_mapped else None
        yield from _sliding(log, ours, across, problem, other.remedy, convention)


def _sliding(
    log: BoxLog,
    steps: Steps,
    wrong: NDArray[np.bool_],
    problem: str,
    remedy: str,
    convention: Convention | None,
) -> Iterator[ImplausibleValue]:
    boxes = np.zeros(len(log.boxes), bool)
    boxes[steps.box[wrong]] = True
    if log.boxes["object_id"][boxes].nunique() >= LEAST_VEHICLES:
        certain = wrong.mean() >= CERTAIN_ACROSS and len(wrong) >= CERTAIN_STEPS
        yield ImplausibleValue("yaw", "yaw", problem, remedy, bool(certain), boxes, convention)


def _has_poses(log: BoxLog) -> bool:
    has_columns = set(POSE_COLUMNS) <= set(log.frames.columns)
    return has_columns and bool(log.frames["ego_yaw"].notna().all())


def _pairs(log: BoxLog) -> pd.DataFrame:
    """Pair boxes of a vehicle in a frame and `STRIDE_S` before it, whose values are `before_…`."""
    order = log.frames.sort_values(["scene", "frame"])
    order["place"] = np.arange(len(order))
    frame_s = order.groupby(["scene", "route"])["timestamp_s"].diff().median()
    stride = math.ceil(min(STRIDE_S / frame_s, 10)) if frame_s > 0 else 1
    runs = -(-len(log.boxes) // MOST_BOXES)
    order = order[order["place"] // (RUN * stride) % runs == 0] if runs else order
    poses = [name for name in POSE_COLUMNS if name in order]
    boxes = log.boxes["frame"].isin(order["frame"]) & (log.boxes["class"] != "Pedestrian")
    rows = np.flatnonzero(boxes.to_numpy())
    columns = ["scene", "frame", "object_id", "x", "y", "yaw"]
    table = log.boxes.iloc[rows][columns].assign(row=rows)
    table = table.merge(order[["frame", "place", *poses]], on="frame")
    table = table.sort_values(["scene", "object_id", "place"], ignore_index=True)
    before = table.shift(stride)
    follows = (
        (table["scene"] == before["scene"])
        & (table["object_id"] == before["object_id"])
        & (table["place"] == before["place"] + stride)
    )
    return table.join(before[["x", "y", *poses]].add_prefix("before_"))[follows]


def _steps_by_poses(pairs: pd.DataFrame, other: Alternative) -> Steps:
    def place(prefix: str) -> NDArray[np.float64]:
        x, y = _place(pairs, prefix, other)
        if other.place == "world":
            return np.stack([x, y])
        ego_x, ego_y, ego_yaw = _columns(pairs, prefix, *POSE_COLUMNS)
        turn = ego_yaw if other.place == "ego" else 0 * ego_yaw
        cos, sin = np.cos(turn), np.sin(turn)
        return np.stack([ego_x + cos * x - sin * y, ego_y + sin * x + cos * y])

    dx, dy = place("") - place("before_")
    yaw, ego_yaw = _columns(pairs, "", "yaw", "ego_yaw")
    yaw = other.convention.yaws(yaw)
    if other.yaw == "ego":
        yaw += other.convention.factor * ego_yaw if other.turned else ego_yaw
    across, ahead = np.cos(yaw) * dy - np.sin(yaw) * dx, np.cos(yaw) * dx + np.sin(yaw) * dy
    length = np.hypot(dx, dy)
    moved = length > STEP_M
    sine = np.abs(across[moved]) / length[moved]
    return Steps(sine, ahead[moved] < 0, pairs["row"].to_numpy(np.int64)[moved])


def _steps_without_poses(pairs: pd.DataFrame, other: Alternative, stands: bool = False) -> Steps:
    """Compute steps with the motion of the vehicle under which objects slide least, if it moves.

    Its motion is v ahead and w to the left; or it `stands`. `n·(d + v e_x + w e_z × p) = 0` by
    least squares in each frame, n the normal of an object's length axis, d its step and p its place
    in the ego frame. Needs over two objects in a frame."""
    x, y = _place(pairs, "", other)
    before_x, before_y = _place(pairs, "before_", other)
    yaw = other.convention.yaws(pairs["yaw"])
    dx, dy = x - before_x, y - before_y
    cos, sin = np.cos(yaw), np.sin(yaw)
    slide = cos * dy - sin * dx
    frame, count = np.unique(pairs["frame"].to_numpy(), return_inverse=True, return_counts=True)[1:]
    count = count[frame]
    if not stands:
        by_motion = np.stack([-sin, sin * y + cos * x], axis=1)
        terms = by_motion[:, :, None] * np.column_stack([by_motion, -slide])[:, None]
        sums = np.zeros((int(frame.max(initial=-1)) + 1, 2, 3))
        np.add.at(sums, frame, terms)
        motion = np.linalg.pinv(sums[..., :2], hermitian=True) @ sums[..., 2:]
        slide += (by_motion * motion[frame, :, 0]).sum(axis=1)
        slide *= np.sqrt(count / np.maximum(count - UNKNOWNS, 1))
    length = np.hypot(dx, dy)
    moved = (length > STEP_M) & (count > UNKNOWNS)
    sine = np.abs(slide[moved]) / length[moved]
    return Steps(sine, np.zeros(len(sine), bool), pairs["row"].to_numpy(np.int64)[moved])


def _place(pairs: pd.DataFrame, prefix: str, other: Alternative) -> NDArray[np.float64]:
    """Return x and y in the ego frame, (2, pairs)."""
    return other.convention.matrix[:2, :2] @ _columns(pairs, prefix, "x", "y")


def _columns(pairs: pd.DataFrame, prefix: str, *names: str) -> NDArray[np.float64]:
    return pairs[[prefix + name for name in names]].to_numpy(np.float64).T
