"""Rays one after the other, in plain Python: what counts are compared with."""

import math

import numpy as np

from lidarplace import Placement
from lidarplace.mounting.vehicle import Vehicle


def entered(origin, direction, low, high):
    """Distance at which a ray enters a box by slabs, inf if it misses or starts inside."""
    near, far = -math.inf, math.inf
    for axis in range(3):
        if direction[axis] == 0.0:
            if not low[axis] <= origin[axis] <= high[axis]:
                return math.inf
            continue
        ends = [(end[axis] - origin[axis]) / direction[axis] for end in (low, high)]
        near, far = max(near, min(ends)), min(far, max(ends))
    return near if 0 < near <= far else math.inf


def incidence(local, direction, reach, size):
    """Cosine between a ray and the normal of the face that it meets: the one nearest to it."""
    at = local + reach * direction
    return min(
        (min(abs(at[axis]), abs(at[axis] - size[axis])), abs(direction[axis])) for axis in range(3)
    )[1]


def in_frame_of(box, origin, directions):
    """Return a point and directions (n, 3) in the own frame of a box, from its lower right rear.

    box: a row of GEOMETRY.
    """
    c, s = math.cos(box[6]), math.sin(box[6])
    to_box = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]])
    return to_box @ (origin - np.array(box[:3])) + np.array(box[3:6]) / 2, directions @ to_box.T


def hits_of(placement: Placement, vehicle: Vehicle, box, reflectivity=0.1):
    """Return the points on a box where rays of every LiDAR end, see `in_frame_of`."""
    hits, bodies = [], vehicle.interior.tolist()  # numbers of Python are quicker here
    for mount, lidar in zip(placement.mounts, placement.lidars, strict=True):
        eye, rays = mount.position.tolist(), lidar.directions() @ mount.rotation.T
        local, ways = in_frame_of(box, mount.position, rays)
        of_lidar = []
        for ray, along in zip(rays.tolist(), ways, strict=True):
            reach = entered(local.tolist(), along.tolist(), [0.0] * 3, box[3:6])
            if math.isinf(reach):
                continue
            body = min((entered(eye, ray, *corners) for corners in bodies), default=math.inf)
            away = reach * math.exp(lidar.extinction * reach)  # of equal light in clear air
            far = away if lidar.range_10 is None else reach
            if not (lidar.min_range <= reach < body and far < lidar.range):
                continue
            cosine = incidence(local, along, reach, box[3:6])
            if reach <= lidar.sight(reflectivity * cosine):
                of_lidar.append(local + reach * along)
        hits.append(of_lidar)
    return hits


def cells_of(points, size, cell):
    """Distinct cells of the points."""
    slices = [max(math.ceil(edge / cell - 1e-9), 1) for edge in size]
    return {
        tuple(min(max(math.floor(p / cell), 0), n - 1) for p, n in zip(point, slices, strict=True))
        for point in points
    }
