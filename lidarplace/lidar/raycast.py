"""Rays against oriented boxes and the ground; the nearest hit wins. Compiled kernels."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

GROUND, NOTHING, OWN_BODY = -1, -2, -3
"""What a ray hit, where it is no box: boxes are numbered from 0."""


@njit(cache=True)
def _entry(ox, oy, oz, dx, dy, dz, hx, hy, hz):  # pragma: no cover - compiled
    """Ray parameter at which a ray from outside enters the box |x| <= hx, ..., inf if it misses.

    A ray that starts inside does not see the box: its faces are seen from outside only.
    The axis of the entry face is returned beside it.
    """
    near, far, face = -math.inf, math.inf, 0
    for axis, o, d, h in ((0, ox, dx, hx), (1, oy, dy, hy), (2, oz, dz, hz)):
        if d == 0.0:
            if abs(o) > h:
                return math.inf, 0
            continue
        t0, t1 = (-h - o) / d, (h - o) / d
        if t0 > t1:
            t0, t1 = t1, t0
        if t0 > near:
            near, face = t0, axis
        far = min(far, t1)
    if near > 0 and near <= far:
        return near, face
    return math.inf, 0


@njit(cache=True)
def _seen_from(ox, oy, oz, rotation, box):  # pragma: no cover - compiled
    """Where a box lies as seen by a sensor.

    Returns (azimuth of its centre, lowest and highest azimuth relative to that, lowest and highest
    elevation), radians in the sensor's frame; the bounds contain the box. A box that the sensor's
    axis may pierce has all azimuths and elevations.
    """
    x, y, z, length, width, height, yaw = box
    c, s = math.cos(yaw), math.sin(yaw)
    px, py, pz = x - ox, y - oy, z - oz
    # Into the sensor's frame: the transposed rotation.
    cx = rotation[0, 0] * px + rotation[1, 0] * py + rotation[2, 0] * pz
    cy = rotation[0, 1] * px + rotation[1, 1] * py + rotation[2, 1] * pz
    distance = math.hypot(cx, cy)
    if distance == 0.0:
        return 0.0, -math.pi, math.pi, -math.pi / 2, math.pi / 2
    ux, uy = cx / distance, cy / distance
    near, far = math.inf, 0.0
    low, high = math.inf, -math.inf
    left, right = math.inf, -math.inf
    for i in (-0.5, 0.5):
        for j in (-0.5, 0.5):
            for k in (-0.5, 0.5):
                bx, by, bz = i * length, j * width, k * height
                qx, qy, qz = px + c * bx - s * by, py + s * bx + c * by, pz + bz
                sx = rotation[0, 0] * qx + rotation[1, 0] * qy + rotation[2, 0] * qz
                sy = rotation[0, 1] * qx + rotation[1, 1] * qy + rotation[2, 1] * qz
                sz = rotation[0, 2] * qx + rotation[1, 2] * qy + rotation[2, 2] * qz
                along, across = sx * ux + sy * uy, sy * ux - sx * uy
                near, far = min(near, along), max(far, math.hypot(sx, sy))
                low, high = min(low, sz), max(high, sz)
                if along > 0:
                    angle = math.atan2(across, along)
                    left, right = min(left, angle), max(right, angle)
    if near <= 0:
        return 0.0, -math.pi, math.pi, -math.pi / 2, math.pi / 2
    lowest = math.atan2(low, near if low < 0 else far)
    highest = math.atan2(high, near if high > 0 else far)
    return math.atan2(cy, cx), left, right, lowest, highest


@njit(cache=True)
def background(origin, directions, reach, own_body, active):
    """First hits on what is the same in every frame: the ground and the vehicle itself.

    Args:
        origin: position of the sensor, ego frame, shape (3,), metres.
        directions: of the rays, ego frame, in the order of `Lidar.directions`, shape (rays, 3).
        reach: farthest return, metres.
        own_body: x, y, z, length, width, height, yaw of the vehicle itself, shape (7,).
        active: rays to cast, shape (rays,), bool.

    Returns:
        (distance, hit, incidence): metres (inf where nothing was hit, 0 for rays that are not
        active, so that nothing is nearer), GROUND, NOTHING or OWN_BODY, and the cosine of the
        angle between ray and surface normal.
    """
    distance = np.where(active, math.inf, 0.0)
    hit = np.full(len(directions), NOTHING, np.int32)
    incidence = np.zeros(len(directions))
    c, s = math.cos(own_body[6]), math.sin(own_body[6])
    px, py, pz = origin[0] - own_body[0], origin[1] - own_body[1], origin[2] - own_body[2]
    for ray in range(len(directions)):
        if not active[ray]:
            continue
        x, y, z = directions[ray]
        if origin[2] > 0 and -z * reach >= origin[2]:
            distance[ray], hit[ray], incidence[ray] = -origin[2] / z, GROUND, -z
        t, _ = _entry(
            *(c * px + s * py, c * py - s * px, pz, c * x + s * y, c * y - s * x, z),
            *(own_body[3] / 2, own_body[4] / 2, own_body[5] / 2),
        )
        if t < distance[ray] and t <= reach:
            distance[ray], hit[ray] = t, OWN_BODY
    return distance, hit, incidence


@njit(cache=True)
def cast(origin, rotation, elevations, directions, reach, boxes, behind):
    """First hits of all rays of one turning LiDAR in one frame.

    Args:
        origin, directions, reach: as in `background`.
        rotation: sensor-to-ego rotation, shape (3, 3).
        elevations: of the beams, radians, shape (beams,).
        boxes: x, y, z, length, width, height, yaw, ego frame, shape (n, 7).
        behind: result of `background`.

    Returns:
        (distance, hit, incidence) as from `background`, with the index of the box where one was
        hit first.
    """
    distance, hit, incidence = behind[0].copy(), behind[1].copy(), behind[2].copy()
    azimuth_steps = len(directions) // len(elevations)
    step = 2 * math.pi / azimuth_steps
    for n in range(len(boxes)):
        box = boxes[n]
        centre, left, right, lowest, highest = _seen_from(
            origin[0], origin[1], origin[2], rotation, box
        )
        # A hair more on each side: rounding must not cut a ray off.
        first = math.ceil((centre + left - 1e-9) / step)
        last = math.floor((centre + right + 1e-9) / step)
        if last - first >= azimuth_steps:
            first, last = 0, azimuth_steps - 1
        c, s = math.cos(box[6]), math.sin(box[6])
        px, py, oz = origin[0] - box[0], origin[1] - box[1], origin[2] - box[2]
        ox, oy = c * px + s * py, c * py - s * px
        hx, hy, hz = box[3] / 2, box[4] / 2, box[5] / 2
        for b in range(len(elevations)):
            if not lowest - 1e-9 <= elevations[b] <= highest + 1e-9:
                continue
            for index in range(first, last + 1):
                ray = b * azimuth_steps + index % azimuth_steps
                x, y, z = directions[ray]
                dx, dy = c * x + s * y, c * y - s * x
                t, face = _entry(ox, oy, oz, dx, dy, z, hx, hy, hz)
                if t < distance[ray] and t <= reach:
                    distance[ray], hit[ray] = t, n
                    incidence[ray] = abs(dx if face == 0 else dy if face == 1 else z)
    return distance, hit, incidence


@njit(cache=True)
def visible_shares(viewpoint, boxes, wanted, columns, rows):
    """Share of each wanted box that is not hidden behind others, seen from one point.

    Rays spread over the angles that a box takes up, `columns` by `rows` of them; of those that
    would hit the box alone, the share that hits it before any other box.

    Args:
        viewpoint: shape (3,), metres.
        boxes: the boxes of one frame, shape (n, 7).
        wanted: which of them to look at, shape (n,), bool.

    Returns:
        Shares in [0, 1], shape (n,); 0 where not wanted, 1 for a box that holds the viewpoint.
    """
    shares = np.zeros(len(boxes))
    upright = np.eye(3)
    local = np.empty((len(boxes), 5))
    for n in range(len(boxes)):
        c, s = math.cos(boxes[n, 6]), math.sin(boxes[n, 6])
        px, py = viewpoint[0] - boxes[n, 0], viewpoint[1] - boxes[n, 1]
        local[n] = c * px + s * py, c * py - s * px, viewpoint[2] - boxes[n, 2], c, s
    for n in range(len(boxes)):
        if not wanted[n]:
            continue
        half = boxes[n, 3:6] / 2
        if (np.abs(local[n, :3]) <= half).all():
            shares[n] = 1.0
            continue
        centre, left, right, lowest, highest = _seen_from(
            viewpoint[0], viewpoint[1], viewpoint[2], upright, boxes[n]
        )
        alone, first = 0, 0
        for i in range(columns):
            azimuth = centre + left + (i + 0.5) / columns * (right - left)
            for j in range(rows):
                elevation = lowest + (j + 0.5) / rows * (highest - lowest)
                dx = math.cos(elevation) * math.cos(azimuth)
                dy = math.cos(elevation) * math.sin(azimuth)
                dz = math.sin(elevation)
                own = math.inf
                nearest = math.inf
                for m in range(-1, len(boxes)):  # the box itself, then the others
                    k = n if m < 0 else m
                    if k == n and m >= 0:
                        continue
                    ox, oy, oz, c, s = local[k]
                    t, _ = _entry(
                        *(ox, oy, oz, c * dx + s * dy, c * dy - s * dx, dz),
                        *(boxes[k, 3] / 2, boxes[k, 4] / 2, boxes[k, 5] / 2),
                    )
                    if k == n:
                        own = t
                        if own == math.inf:
                            break
                    else:
                        nearest = min(nearest, t)
                if own < math.inf:
                    alone += 1
                    first += own <= nearest
        if alone:
            shares[n] = first / alone
    return shares
