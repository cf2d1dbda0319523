"""Boxes that look like another unit, or cannot be where they are: too far, or off the ground."""

import math
from collections.abc import Iterator

import numpy as np
import pandas as pd

from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import SIZE
from lidarplace.logs.plausible import MOST_SIZE_M, MOST_YAW
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.scenes.sanity_checks.doubt import LEAST_BOXES, Doubt

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
    "Car": np.array([(2.6, 1.0, 0.9), (20.0, 3.2, 4.5)]),
    "Cyclist": np.array([(1.0, 0.2, 0.8), (25.0, 3.2, 4.5)]),
    "Pedestrian": np.array([(0.15, 0.15, 0.9), (1.5, 1.5, 2.5)]),
}
"""Least and most length, width and height of the median object of a class. The limits are between
those of real ones and half of them, or the triple, as of feet; a Cyclist may be a box truck."""
LEAST_WHOLE = 3  # so many turned boxes, all by whole numbers of radians, are no chance


def doubts_of_units(log: BoxLog) -> Iterator[Doubt]:
    """Doubts of yaw and size, box by box."""
    yaw = log.boxes["yaw"].to_numpy(np.float64)
    far, turned = np.abs(yaw) > MOST_YAW, yaw != 0
    if far.any():
        why = "yaw is in radians; over two turns"
        yield Doubt("yaw", "yaw", far, why, "units.angle", certain=True)
    elif turned.sum() >= LEAST_WHOLE and (yaw[turned] % 1 == 0).all():
        why = "yaw is in radians; all are whole numbers, as of degrees"
        yield Doubt("yaw", "yaw", turned, why, "units.angle", bool(turned.sum() >= LEAST_BOXES))
    too_large = log.boxes[list(SIZE)].to_numpy(np.float64) > MOST_SIZE_M
    if (large := np.asarray(too_large.any(axis=1))).any():
        why = f"sizes are in metres; over {MOST_SIZE_M:g} m"
        certain = too_large.all(axis=1).any()  # a tram is long, but not as wide and high
        yield Doubt("size", SIZE[0], large, why, "units.size", bool(certain))


def doubts_of_degrees(log: BoxLog) -> Iterator[Doubt]:
    """Doubt of a yaw that was read as degrees: it ends at pi, or 2 pi, where radians end."""
    ends = np.radians([math.pi, 2 * math.pi])
    largest = log.boxes["yaw"].abs().max()
    if len(log.boxes) >= LEAST_BOXES and ((0.97 * ends < largest) & (largest <= ends)).any():
        why = f"yaw ends at {math.degrees(largest):.2f} degrees, where radians end"
        yield Doubt("yaw", "yaw", np.ones(len(log.boxes), bool), why, "units.angle: rad")


def doubts_of_surroundings(log: BoxLog) -> Iterator[Doubt]:
    """Doubts of the sizes of a class, of places and heights."""
    for doubts in (_sizes, _places, _heights) if len(log.boxes) else ():
        yield from doubts(log.boxes)


def _sizes(boxes: pd.DataFrame) -> Iterator[Doubt]:
    sizes = boxes[list(SIZE)].to_numpy(np.float64)
    codes, names = pd.factorize(boxes["class"])
    for name, (low, high) in SIDES_M.items():
        if name not in names:
            continue
        rows = codes == list(names).index(name)
        median = np.median(sizes[rows], axis=0)
        wrong = [n for n in range(3) if not low[n] <= median[n] <= high[n]]
        remedy = "columns.length, columns.width and columns.height"
        if not median.any():
            continue  # points, not boxes
        if name == "Car" and (n := int(median.argmax())):
            why = f"cars are {('', 'wider', 'higher')[n]} than long in the median"
        elif wrong:
            remedy = f"units.size, or the order of {remedy}"
            n = wrong[0]
            why = f"the {SIZE[n]} of a {name} is {median[n]:g} m in the median, expected "
            why += f"{low[n]:g} to {high[n]:g}"
            if median[n] < low[n] and ((low <= 2 * median) & (2 * median <= high)).all():
                why += ", as of half sizes"
                remedy = "the sizes (twice these half extents)"
        else:
            continue
        if boxes["object_id"][rows].nunique() >= LEAST_OBJECTS:
            yield Doubt("size", SIZE[0], rows, why, remedy, bool(rows.sum() >= LEAST_BOXES))
            return


def _places(boxes: pd.DataFrame) -> Iterator[Doubt]:
    x, y = (boxes[name].to_numpy(np.float64) for name in "xy")
    distance = np.hypot(x, y)
    every = np.ones(len(distance), bool)
    if (far := distance > FARTHEST_M).any():
        why = f"farther than {FARTHEST_M:,.0f} m from the vehicle"
        remedy = "units.position, or coordinates: world with poses"
        yield Doubt("place", "x", far, why, remedy, bool(far.mean() > OFTEN))
        return
    if len(distance) >= LEAST_BOXES and distance.max() < NEAREST_M:
        why = f"nothing is farther than {NEAREST_M:g} m from the vehicle"
        yield Doubt("place", "x", every, why, "units.position", certain=True)
        return
    if len(distance) >= LEAST_BOXES and (median := np.median(distance)) > FAR_M:
        why = f"boxes are {median:.0f} m from the vehicle in the median"
        remedy = "units.position, or coordinates: world with poses"
        yield Doubt("place", "x", distance > FAR_M, why, remedy)
    low, high = Vehicle.car().boxes[0][:, :2]
    within = (low[0] < x) & (x < high[0]) & (low[1] < y) & (y < high[1])
    if within.mean() > IN_VEHICLE:
        why = "the centre is in the body of the vehicle"
        remedy = "units.position, coordinates, or classes: the own vehicle is null"
        yield Doubt("place", "x", within, why, remedy)


def _heights(boxes: pd.DataFrame) -> Iterator[Doubt]:
    x, y, z, height = (boxes[name].to_numpy(np.float64) for name in ("x", "y", "z", "height"))
    near = np.hypot(x, y) < NEAR_M
    bottom = z - height / 2
    if near.sum() < LEAST_BOXES or not abs(median := np.median(bottom[near])) > OFF_GROUND_M:
        return
    why = f"the undersides of near boxes are {median:+.2f} m off the ground in the median"
    if abs(np.median(z[near])) < OFF_GROUND_M:
        remedy = "box_z: bottom"
    elif median > 0 and abs(median - np.median(height[near]) / 2) < OFF_GROUND_M:
        remedy = "box_z: centre"
    else:
        remedy = f"origin.z, {-median:+.2f} m from its value, or units.position"
    rows = near & (np.abs(bottom) > OFF_GROUND_M)
    yield Doubt("ground", "z", rows, why, remedy, bool(abs(median) > NO_SLOPE_M))
