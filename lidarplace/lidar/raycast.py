"""Cast the rays of a LiDAR at boxes, the ground and the vehicle's own body.

Every ray goes to the nearest surface that it *enters*: a box around the sensor is transparent,
because its inside is no surface to return from. Boxes are rasterised in the sensor's azimuth and
elevation, so a box costs only the rays that can meet it; the result is that of testing every ray
against every box.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidarplace.placement import Mount
from lidarplace.sensor import Lidar

OWN_BODY = (0.0, 0.0, 0.75, 4.6, 1.9, 1.5, 0.0)
"""The vehicle's own body: a box in the ego frame, `x, y, z, length, width, height, yaw`."""

GROUND, NOTHING, BODY = -1, -2, -3
"""What a ray hit when it was no box."""


@dataclass(frozen=True)
class Hits:
    """What every ray of a LiDAR meets first, in the order of `Lidar.directions()`.

    Attributes:
        range: metres, `inf` where nothing is met within the LiDAR's range, shape (rays,), float64.
        target: row of the box, or GROUND, NOTHING, BODY, shape (rays,), int32.
        incidence: cosine between ray and surface normal, 0 where nothing is met, shape (rays,),
            float64.
    """

    range: NDArray[np.float64]
    target: NDArray[np.int32]
    incidence: NDArray[np.float64]


EVERYWHERE = (-math.inf, -math.inf, -math.inf, math.inf, math.inf, math.inf)


def cast(
    mount: Mount,
    lidar: Lidar,
    boxes: NDArray[np.float64],
    crop: Sequence[float] = EVERYWHERE,
    into: Hits | None = None,
) -> Hits:
    """Cast all rays of one LiDAR; range noise and drop-off are not applied.

    Args:
        mount: pose in the ego frame.
        lidar: beams, azimuth steps, field of view and range.
        boxes: rows of `lidarplace.boxes.GEOMETRY` in the ego frame, shape (B, 7), finite.
        crop: x0, y0, z0, x1, y1, z1 in the ego frame, metres. Hits within it are right, for rays
            that meet nothing there the answer is open: boxes that cannot matter are skipped.
        into: hits of an earlier call for the same `lidar`, whose memory is used again.
    """
    rays = lidar.rays
    hits = into or Hits(np.empty(rays), np.empty(rays, np.int32), np.empty(rays))
    _cast(
        mount.position,
        mount.rotation,
        *beam_tables(lidar),
        lidar.first_step,
        lidar.azimuth_steps,
        lidar.range,
        np.ascontiguousarray(boxes, np.float64),
        np.array(OWN_BODY),
        np.array(crop, np.float64),
        hits.range,
        hits.target,
        hits.incidence,
    )
    return hits


@lru_cache(maxsize=16)
def beam_tables(lidar: Lidar) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Elevations (beams, 3): angle, cosine, sine; fired azimuths (fired_steps, 2): cosine, sine."""
    elevation = np.asarray(lidar.elevations)
    azimuth = lidar.azimuths()
    elevations = np.stack([elevation, np.cos(elevation), np.sin(elevation)], axis=1)
    azimuths = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    for table in (elevations, azimuths):
        table.flags.writeable = False  # shared by all callers
    return elevations, azimuths


def visible_share(
    viewpoint: tuple[float, float, float],
    boxes: NDArray[np.float64],
    grid: tuple[int, int],
) -> NDArray[np.float64]:
    """Share of each box that an ideal sensor at `viewpoint` sees past the others, shape (B,).

    A grid of (azimuths, elevations) rays spans the angles of each box. Of the rays that enter the
    box when it is alone, the share that meets no other box before. 0 if no ray enters the box:
    it is thinner than the grid, or holds the viewpoint.

    Args:
        viewpoint: x, y, z in the ego frame, metres. Ground and own body hide nothing.
        boxes: rows of `lidarplace.boxes.GEOMETRY` of one frame, shape (B, 7), finite.
        grid: rays along azimuth and along elevation.
    """
    return _visible_share(np.array(viewpoint), np.ascontiguousarray(boxes), grid[0], grid[1])


@njit(cache=True)
def _extent(box, origin, rotation):
    """Azimuths and elevations under which `box` can appear in the sensor's frame.

    Returns (centre azimuth, half width below, half width above, lowest, highest elevation); the
    half widths are pi if the sensor's axis meets the box or passes close by. The azimuths are
    those of the corners, exact; the elevations are bounds, from the corners' heights and the disc
    around them.
    """
    c, s = math.cos(box[6]), math.sin(box[6])
    corners = np.empty((8, 3))
    for n in range(8):
        lx = box[3] * (0.5 if n & 1 else -0.5)
        ly = box[4] * (0.5 if n & 2 else -0.5)
        ex = box[0] + c * lx - s * ly - origin[0]
        ey = box[1] + s * lx + c * ly - origin[1]
        ez = box[2] + box[5] * (0.5 if n & 4 else -0.5) - origin[2]
        for k in range(3):
            corners[n, k] = rotation[0, k] * ex + rotation[1, k] * ey + rotation[2, k] * ez
    mx, my = corners[:, 0].mean(), corners[:, 1].mean()
    middle = math.atan2(my, mx)
    distance = math.hypot(mx, my)
    below = above = radius = 0.0
    nearest = np.inf
    lowest, highest = np.inf, -np.inf
    for n in range(8):
        x, y, z = corners[n]
        turn = math.atan2(y, x) - middle
        if turn > math.pi:
            turn -= 2 * math.pi
        elif turn < -math.pi:
            turn += 2 * math.pi
        below, above = max(below, -turn), max(above, turn)
        radius = max(radius, math.hypot(x - mx, y - my))
        nearest = min(nearest, math.hypot(x, y))
        lowest, highest = min(lowest, z), max(highest, z)
    # Seen from outside, a convex shape spans less than half a turn.
    if below + above > math.pi - 1e-6 or nearest < 1e-6:
        below = above = math.pi
    near, far = max(distance - radius, 0.0), distance + radius
    lowest = math.atan2(lowest, near if lowest < 0 else far)
    highest = math.atan2(highest, near if highest > 0 else far)
    return middle, below, above, lowest - 1e-9, highest + 1e-9


@njit(cache=True)
def _azimuth_run(middle, below, above, steps):
    """First azimuth step, in [0, steps), and number of steps of an interval of azimuths."""
    per_step = 2 * math.pi / steps
    # One step wider than the interval on both sides, so that rounding costs nothing.
    first = math.floor((middle - below) / per_step)
    count = math.ceil((middle + above) / per_step) - first + 1
    if count >= steps:
        return 0, steps
    return first % steps, count


@njit(cache=True, error_model="numpy")
def _enter(ox, oy, oz, dx, dy, dz, hx, hy, hz):
    """Where a ray enters the box |x| <= hx, |y| <= hy, |z| <= hz, and the cosine of incidence.

    Slab method. Returns (inf, 0) for a ray that does not enter from outside. A ray parallel to a
    slab is inside it for ever or never; dividing by its zero, or by a number whose inverse
    overflows, would give NaN.
    """
    enter, leave, cosine = -np.inf, np.inf, 0.0
    if abs(dx) > 1e-290:
        inverse = 1.0 / dx
        centre, half = -ox * inverse, abs(hx * inverse)
        enter, leave, cosine = centre - half, centre + half, abs(dx)
    elif abs(ox) > hx:
        return np.inf, 0.0
    if abs(dy) > 1e-290:
        inverse = 1.0 / dy
        centre, half = -oy * inverse, abs(hy * inverse)
        if centre - half > enter:
            enter, cosine = centre - half, abs(dy)
        leave = min(leave, centre + half)
    elif abs(oy) > hy:
        return np.inf, 0.0
    if abs(dz) > 1e-290:
        inverse = 1.0 / dz
        centre, half = -oz * inverse, abs(hz * inverse)
        if centre - half > enter:
            enter, cosine = centre - half, abs(dz)
        leave = min(leave, centre + half)
    elif abs(oz) > hz:
        return np.inf, 0.0
    if 0.0 <= enter <= leave:
        return enter, cosine
    return np.inf, 0.0


@njit(cache=True, error_model="numpy")
def _cast(
    origin,
    rotation,
    elevations,
    azimuths,
    first_step,
    turn,
    reach,
    boxes,
    body,
    crop,
    ranges,
    targets,
    incidences,
):
    """Fill range, target and incidence of every ray; exact for what lies within `crop`.

    Boxes apart from the hull of crop and sensor are skipped: the hull is convex, so it holds
    every ray up to a point in `crop`, and they cannot stand before one. `azimuths` are those
    fired: from `first_step` on, of `turn` steps in a full turn.
    """
    steps = len(azimuths)
    for beam in range(len(elevations)):
        ce, se = elevations[beam, 1], elevations[beam, 2]
        z0, z1, z2 = rotation[2, 0] * ce, rotation[2, 1] * ce, rotation[2, 2] * se
        for step in range(steps):
            ray = beam * steps + step
            dz = z0 * azimuths[step, 0] + z1 * azimuths[step, 1] + z2
            ground = -origin[2] / dz if dz < 0.0 else np.inf
            met = 0.0 <= ground <= reach and ground < np.inf  # the range may be infinite
            ranges[ray] = ground if met else np.inf
            targets[ray] = -1 if met else -2
            incidences[ray] = -dz if met else 0.0

    for b in range(-1, len(boxes)):
        box = body if b < 0 else boxes[b]
        radius = 0.5 * math.sqrt(box[3] ** 2 + box[4] ** 2 + box[5] ** 2)
        apart = False
        away = 0.0
        for axis in range(3):
            low, high = min(crop[axis], origin[axis]), max(crop[axis + 3], origin[axis])
            apart |= box[axis] + radius < low or box[axis] - radius > high
            away += (box[axis] - origin[axis]) ** 2
        if apart or math.sqrt(away) - radius > reach:
            continue

        c, s = math.cos(box[6]), math.sin(box[6])
        ex, ey = origin[0] - box[0], origin[1] - box[1]
        ox, oy, oz = c * ex + s * ey, c * ey - s * ex, origin[2] - box[2]
        hx, hy, hz = 0.5 * box[3], 0.5 * box[4], 0.5 * box[5]
        # Rows of the sensor-to-box rotation.
        x0, y0, z0 = (
            c * rotation[0, 0] + s * rotation[1, 0],
            c * rotation[1, 0] - s * rotation[0, 0],
            rotation[2, 0],
        )
        x1, y1, z1 = (
            c * rotation[0, 1] + s * rotation[1, 1],
            c * rotation[1, 1] - s * rotation[0, 1],
            rotation[2, 1],
        )
        x2, y2, z2 = (
            c * rotation[0, 2] + s * rotation[1, 2],
            c * rotation[1, 2] - s * rotation[0, 2],
            rotation[2, 2],
        )
        middle, below, above, lowest, highest = _extent(box, origin, rotation)
        first, count = _azimuth_run(middle, below, above, turn)
        first -= first_step if first >= first_step else first_step - turn
        for beam in range(len(elevations)):
            if not lowest <= elevations[beam, 0] <= highest:
                continue
            ce, se = elevations[beam, 1], elevations[beam, 2]
            for n in range(count):
                step = first + n
                if step >= turn:
                    step -= turn
                if step >= steps:  # outside the field of view
                    continue
                ca, sa = ce * azimuths[step, 0], ce * azimuths[step, 1]
                enter, cosine = _enter(
                    ox,
                    oy,
                    oz,
                    x0 * ca + x1 * sa + x2 * se,
                    y0 * ca + y1 * sa + y2 * se,
                    z0 * ca + z1 * sa + z2 * se,
                    hx,
                    hy,
                    hz,
                )
                ray = beam * steps + step
                if enter < ranges[ray] and enter <= reach:
                    ranges[ray] = enter
                    targets[ray] = b if b >= 0 else -3
                    incidences[ray] = cosine


@njit(cache=True)
def _visible_share(viewpoint, boxes, azimuths, elevations):
    number = len(boxes)
    upright = np.eye(3)
    extents = np.empty((number, 5))
    near = np.empty(number)
    far = np.empty(number)
    for b in range(number):
        box = boxes[b]
        extents[b] = _extent(box, viewpoint, upright)
        radius = 0.5 * math.sqrt(box[3] ** 2 + box[4] ** 2 + box[5] ** 2)
        away = math.sqrt(
            (box[0] - viewpoint[0]) ** 2
            + (box[1] - viewpoint[1]) ** 2
            + (box[2] - viewpoint[2]) ** 2
        )
        near[b], far[b] = away - radius, away + radius
    before = np.empty(number, np.int64)
    share = np.zeros(number)
    for b in range(number):
        middle, below, above, lowest, highest = extents[b]
        others = 0
        for o in range(number):
            turn = abs(extents[o, 0] - middle)
            turn = min(turn, 2 * math.pi - turn)
            widths = max(below, above) + max(extents[o, 1], extents[o, 2])
            if o != b and near[o] <= far[b] and turn <= widths + 1e-9:
                before[others] = o
                others += 1
        alone = seen = 0
        for i in range(azimuths):
            azimuth = middle - below + (below + above) * (i + 0.5) / azimuths
            for j in range(elevations):
                elevation = lowest + (highest - lowest) * (j + 0.5) / elevations
                dx = math.cos(elevation) * math.cos(azimuth)
                dy = math.cos(elevation) * math.sin(azimuth)
                dz = math.sin(elevation)
                enter = _enter_posed(viewpoint, dx, dy, dz, boxes[b])
                if enter == np.inf:
                    continue
                alone += 1
                hidden = False
                for k in range(others):
                    if _enter_posed(viewpoint, dx, dy, dz, boxes[before[k]]) < enter:
                        hidden = True
                        break
                if not hidden:
                    seen += 1
        if alone > 0:
            share[b] = seen / alone
    return share


@njit(cache=True)
def _enter_posed(origin, dx, dy, dz, box):
    """Where a ray enters `box`, both in the ego frame."""
    c, s = math.cos(box[6]), math.sin(box[6])
    ex, ey = origin[0] - box[0], origin[1] - box[1]
    enter, _ = _enter(
        c * ex + s * ey,
        c * ey - s * ex,
        origin[2] - box[2],
        c * dx + s * dy,
        c * dy - s * dx,
        dz,
        0.5 * box[3],
        0.5 * box[4],
        0.5 * box[5],
    )
    return enter
