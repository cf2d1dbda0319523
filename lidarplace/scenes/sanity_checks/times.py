"""Times and poses of frames that look like another unit or order."""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import POSE_COLUMNS
from lidarplace.logs.plausibility import STEP_S, ImplausibleValue
from lidarplace.scenes.sanity_checks.boxes import LEAST_BOXES

MOST_SPEED = 100.0  # metres a second, 360 km/h, of the vehicle in the median
MOST_STEP_M = 150.0  # of the vehicle from one frame to the next in the median, if time is unknown


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
