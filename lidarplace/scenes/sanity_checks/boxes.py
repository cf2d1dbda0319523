"""Boxes that look like another unit, or cannot be where they are: too far, or off the ground."""

import math
from collections.abc import Iterator

import numpy as np

from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import SIZE
from lidarplace.logs.plausible import MOST_SIZE_M, MOST_YAW, STEP_S
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.scenes.sanity_checks.doubt import Doubt

FARTHEST_M = 1000.0
NEAREST_M = 2.0  # a log none of whose boxes is farther away has another unit
IN_VEHICLE = 0.01  # share of boxes whose centre may be in the vehicle's body: people who touch it
OFF_GROUND_M = 0.25
NEAR_M = 40.0  # boxes up to here show where the ground is; farther away it may rise
LENGTHS_M = {"Car": (1.5, 20.0), "Cyclist": (0.7, 25.0), "Pedestrian": (0.3, 4.0)}
"""Longest side of the median object of a class."""
LEAST_WHOLE = 3  # so many turned boxes, all by whole numbers of radians, are no chance
LEAST_BOXES = 20  # so many boxes come close to a full turn, and are not all next to the vehicle


def doubts_of_units(log: BoxLog) -> Iterator[Doubt]:
    """Doubts of yaw and size, box by box."""
    yaw = log.boxes["yaw"].to_numpy(np.float64)
    far, turned = np.abs(yaw) > MOST_YAW, yaw != 0
    if far.any():
        yield Doubt("yaw", "yaw", far, "yaw is in radians; over two turns", "units.angle")
    elif turned.sum() >= LEAST_WHOLE and (yaw[turned] % 1 == 0).all():
        why = "yaw is in radians; all are whole numbers, as of degrees"
        yield Doubt("yaw", "yaw", turned, why, "units.angle")
    large = (log.boxes[list(SIZE)].max(axis=1) > MOST_SIZE_M).to_numpy()
    if large.any():
        why = f"sizes are in metres; over {MOST_SIZE_M:g} m"
        yield Doubt("size", SIZE[0], large, why, "units.size")


def doubts_of_degrees(log: BoxLog) -> Iterator[Doubt]:
    """Doubt of a yaw that was read as degrees: it ends at pi, or 2 pi, where radians end."""
    ends = np.radians([math.pi, 2 * math.pi])
    largest = log.boxes["yaw"].abs().max()
    if len(log.boxes) >= LEAST_BOXES and ((0.97 * ends < largest) & (largest <= ends)).any():
        why = f"yaw ends at {math.degrees(largest):.2f} degrees, where radians end"
        yield Doubt("yaw", "yaw", np.ones(len(log.boxes), bool), why, "units.angle: rad")


def doubts_of_surroundings(log: BoxLog) -> Iterator[Doubt]:
    """Doubts of the sizes of a class, of places, heights and times."""
    for doubts in (_sizes, _places, _heights, _times) if len(log.boxes) else ():
        yield from doubts(log)


def _sizes(log: BoxLog) -> Iterator[Doubt]:
    longest = log.boxes[list(SIZE)].max(axis=1)
    for name, (least, most) in LENGTHS_M.items():
        own = (log.boxes["class"] == name).to_numpy()
        if own.any() and not least <= (median := longest[own].median()) <= most:
            why = f"the longest side of a {name} is {median:g} m in the median"
            why += f", expected {least:g} to {most:g}"
            yield Doubt("size", SIZE[0], own, why, "units.size")
            return
    cars = (log.boxes["class"] == "Car").to_numpy()
    if cars.any() and log.boxes["length"][cars].median() < log.boxes["width"][cars].median():
        why = "cars are wider than long in the median"
        yield Doubt("size", SIZE[0], cars, why, "columns.length and columns.width")


def _places(log: BoxLog) -> Iterator[Doubt]:
    x, y = (log.boxes[name].to_numpy(np.float64) for name in "xy")
    distance = np.hypot(x, y)
    if (far := distance > FARTHEST_M).any():
        why = f"farther than {FARTHEST_M:,.0f} m from the vehicle"
        yield Doubt("place", "x", far, why, "units.position, or coordinates: world with poses")
        return
    if len(distance) >= LEAST_BOXES and distance.max() < NEAREST_M:
        why = f"nothing is farther than {NEAREST_M:g} m from the vehicle"
        yield Doubt("place", "x", np.ones(len(distance), bool), why, "units.position")
        return
    low, high = Vehicle.car().boxes[0][:, :2]
    within = ((low < np.stack([x, y], 1)) & (np.stack([x, y], 1) < high)).all(axis=1)
    if within.mean() > IN_VEHICLE:
        why = "the centre is in the body of the vehicle"
        remedy = "units.position, coordinates, or classes: the own vehicle is null"
        yield Doubt("place", "x", within, why, remedy)


def _heights(log: BoxLog) -> Iterator[Doubt]:
    boxes = log.boxes
    near = np.hypot(*boxes[["x", "y"]].to_numpy(np.float64).T) < NEAR_M
    bottom = boxes["z"] - boxes["height"] / 2
    median = bottom[near].median()
    if not abs(median) > OFF_GROUND_M:  # NaN: nothing is near
        return
    why = f"the undersides of near boxes are {median:+.2f} m off the ground in the median"
    at = boxes["z"][near].median()
    if abs(at) < OFF_GROUND_M:
        remedy = "box_z: bottom"
    elif median > 0 and abs(median - boxes["height"][near].median() / 2) < OFF_GROUND_M:
        remedy = "box_z: centre"
    else:
        remedy = f"origin.z, {-median:+.2f} m from its value, or units.position"
    yield Doubt("ground", "z", near & (bottom.abs() > OFF_GROUND_M).to_numpy(), why, remedy)


def _times(log: BoxLog) -> Iterator[Doubt]:
    filled = log.frames[log.frames["frame"].isin(log.boxes["frame"])]
    step = filled.groupby("scene")["timestamp_s"].diff().median()
    if step < STEP_S[0] or step > STEP_S[1]:
        why = f"from one frame with boxes to the next it is {step:g} s in the median"
        every = np.ones(len(log.boxes), bool)
        yield Doubt("time", "timestamp_s", every, why, "units.time, or frames.rate_hz")
