"""Boxes that look like another unit, or cannot be where they are: too far, or off the ground."""

import math
from collections.abc import Iterator

import numpy as np
import pandas as pd

from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import SIZE
from lidarplace.logs.plausibility import MOST_SIZE_M, ImplausibleValue, over_two_turns
from lidarplace.mounting.vehicle import Vehicle

LEAST_BOXES = 20  # fewer boxes or frames make nothing certain
FARTHEST_M = 1000.0
FAR_M = 150.0  # the median box of a log in the ego frame is nearer
NEAREST_M = 2.0  # a log none of whose boxes is farther away has another unit
IN_VEHICLE = 0.01  # share of boxes whose centre may be in the vehicle's body: people who touch it
OFF_GROUND_M = 0.25
NO_SLOPE_M = 0.5  # roads that rise do not lift the median box by so much
NEAR_M = 40.0  # boxes up to here show where the ground is; farther away it may rise
LEAST_OBJECTS = 3  # one object may be a scooter car or a statue
OFTEN = 0.1  # share of boxes that are no outliers
SIDES_M = {
    "Car": np.array([(3.0, 1.0, 0.9), (20.0, 3.2, 4.5)]),
    "Cyclist": np.array([(1.0, 0.2, 0.8), (25.0, 3.2, 4.5)]),
    "Pedestrian": np.array([(0.15, 0.15, 0.9), (1.5, 1.5, 2.5)]),
}
"""Least and most length, width and height of the median object of a class. The limits are between
those of real ones and half of them, or the triple, as of feet; a Cyclist may be a box truck."""
LEAST_WHOLE = 3  # so many turned boxes, all by whole numbers of radians, are no chance


def implausible_units(log: BoxLog) -> Iterator[ImplausibleValue]:
    """Check the units of yaw and size, box by box."""
    yaw = log.boxes["yaw"].to_numpy(np.float64)
    far, turned = over_two_turns(yaw), yaw != 0
    if far.any():
        problem = "yaw is in radians; over two turns"
        yield ImplausibleValue("yaw", "yaw", problem, "units.angle", True, far)
    elif turned.sum() >= LEAST_WHOLE and (yaw[turned] % 1 == 0).all():
        problem = "yaw is in radians; all are whole numbers, as of degrees"
        certain = bool(turned.sum() >= LEAST_BOXES)
        yield ImplausibleValue("yaw", "yaw", problem, "units.angle", certain, turned)
    too_large = log.boxes[list(SIZE)].to_numpy(np.float64) > MOST_SIZE_M
    if (large := np.asarray(too_large.any(axis=1))).any():
        problem = f"sizes are in metres; over {MOST_SIZE_M:g} m"
        certain = bool(too_large.all(axis=1).any())  # a tram is long, but not as wide and high
        yield ImplausibleValue("size", SIZE[0], problem, "units.size", certain, large)


def implausible_degrees(log: BoxLog) -> Iterator[ImplausibleValue]:
    """Check a yaw that was read as degrees: it is in radians if it ends at pi, or 2 pi."""
    ends = np.radians([math.pi, 2 * math.pi])
    largest = log.boxes["yaw"].abs().max()
    if len(log.boxes) >= LEAST_BOXES and ((0.97 * ends < largest) & (largest <= ends)).any():
        problem = f"yaw ends at {math.degrees(largest):.2f} degrees, where radians end"
        rows = np.ones(len(log.boxes), bool)
        yield ImplausibleValue("yaw", "yaw", problem, "units.angle: rad", False, rows)


def implausible_surroundings(log: BoxLog) -> Iterator[ImplausibleValue]:
    """Check the sizes of a class, places and heights."""
    for check in (_sizes, _places, _heights) if len(log.boxes) else ():
        yield from check(log.boxes)


def _sizes(boxes: pd.DataFrame) -> Iterator[ImplausibleValue]:
    sizes = boxes[list(SIZE)].to_numpy(np.float64)
    codes, names = pd.factorize(boxes["class"])
    for name, (low, high) in SIDES_M.items():
        if name not in names:
            continue
        rows = codes == list(names).index(name)
        median = np.median(sizes[rows], axis=0)
        outside = [side for side in range(3) if not low[side] <= median[side] <= high[side]]
        remedy = "columns.length, columns.width and columns.height"
        if not median.any():
            continue  # points, not boxes
        if name == "Car" and (longest := int(median.argmax())):
            problem = f"cars are {('', 'wider', 'higher')[longest]} than long in the median"
        elif outside:
            remedy = f"units.size, or the order of {remedy}"
            side = outside[0]
            problem = f"the {SIZE[side]} of a {name} is {median[side]:g} m in the median, expected "
            problem += f"{low[side]:g} to {high[side]:g}"
            if median[side] < low[side] and ((low <= 2 * median) & (2 * median <= high)).all():
                problem += ", as of half sizes"
                remedy = "size (half)"
        else:
            continue
        if boxes["object_id"][rows].nunique() >= LEAST_OBJECTS:
            certain = bool(rows.sum() >= LEAST_BOXES)
            yield ImplausibleValue("size", SIZE[0], problem, remedy, certain, rows)
            return


def _places(boxes: pd.DataFrame) -> Iterator[ImplausibleValue]:
    x, y = (boxes[name].to_numpy(np.float64) for name in "xy")
    distance = np.hypot(x, y)
    remedy = "units.position, or coordinates: world with poses"
    if (far := distance > FARTHEST_M).any():
        problem = f"farther than {FARTHEST_M:,.0f} m from the vehicle"
        yield ImplausibleValue("place", "x", problem, remedy, bool(far.mean() > OFTEN), far)
        return
    if len(distance) >= LEAST_BOXES and distance.max() < NEAREST_M:
        problem = f"nothing is farther than {NEAREST_M:g} m from the vehicle"
        rows = np.ones(len(distance), bool)
        yield ImplausibleValue("place", "x", problem, "units.position", True, rows)
        return
    if len(distance) >= LEAST_BOXES and (median := np.median(distance)) > FAR_M:
        problem = f"boxes are {median:.0f} m from the vehicle in the median"
        yield ImplausibleValue("place", "x", problem, remedy, False, distance > FAR_M)
    low, high = Vehicle.car().boxes[0][:, :2]
    within = (low[0] < x) & (x < high[0]) & (low[1] < y) & (y < high[1])
    if within.mean() > IN_VEHICLE:
        problem = "the centre is in the body of the vehicle"
        remedy = "units.position, coordinates, or classes: the own vehicle is null"
        yield ImplausibleValue("place", "x", problem, remedy, False, within)


def _heights(boxes: pd.DataFrame) -> Iterator[ImplausibleValue]:
    x, y, z, height = (boxes[name].to_numpy(np.float64) for name in ("x", "y", "z", "height"))
    near = np.hypot(x, y) < NEAR_M
    bottom = z - height / 2
    if near.sum() < LEAST_BOXES or not abs(median := np.median(bottom[near])) > OFF_GROUND_M:
        return
    problem = f"the undersides of near boxes are {median:+.2f} m off the ground in the median"
    if abs(np.median(z[near])) < OFF_GROUND_M:
        remedy = "anchor: bottom"
    elif median > 0 and abs(median - np.median(height[near]) / 2) < OFF_GROUND_M:
        remedy = "anchor: centre"
    else:
        remedy = f"origin.z, {-median:+.2f} m from its value, or units.position"
    rows = near & (np.abs(bottom) > OFF_GROUND_M)
    yield ImplausibleValue("ground", "z", problem, remedy, bool(abs(median) > NO_SLOPE_M), rows)
