"""Sines of the elevations under which a LiDAR sees a box: which beams may pass through it.

Lengths are metres in the frame of the grid, relative to the sensor. `n = (n0, n1, n2)` is the
sensor's axis with n2 >= 0, `s` the sine of a beam's elevation. Points and corners of boxes are
tuples, as arrays cost more to hand on than to use."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import inlined, inner

HAIR = 1e-9
"""Share of their edge by which cubes are grown."""
_ULPS = 4e-16  # rounding of a sine: no beam may slip between two voxels


class Sensor(NamedTuple):
    """A turning LiDAR.

    Attributes:
        origin, frame: position (3,), and the axes x, y, z as rows (3, 3).
        sines: of the elevations, sorted.
        azimuth, reach: field of view (2,), and range."""

    origin: NDArray[np.float64]
    frame: NDArray[np.float64]
    sines: NDArray[np.float64]
    azimuth: NDArray[np.float64]
    reach: float


class Lattice(NamedTuple):
    """Grid lines: lower corner of the grid, relative to the sensor, and edge of a voxel."""

    x: float
    y: float
    z: float
    resolution: float


@inner
def lattice_of(sensor, minimum, resolution):
    """Return the `Lattice` of a grid whose lower corner is `minimum`."""
    x, y, z = minimum - sensor.origin
    return Lattice(x, y, z, resolution)


@inlined
def _corner(lattice, line, grow):
    """Return the point where three grid lines meet, moved by `grow` along each axis."""
    (i, j, k), r = line, lattice.resolution
    return lattice.x + i * r + grow, lattice.y + j * r + grow, lattice.z + k * r + grow


@inlined
def box_of(lattice, first, end):
    """Return lower and upper corner of the voxels from `first` to before `end`, grown by a hair."""
    grow = HAIR * lattice.resolution
    return _corner(lattice, first, -grow), _corner(lattice, end, grow)


@inner
def dot(a, b):
    """Return the scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner
def _widened_by_edge(a, e, n, least, most):
    """Widen (least, most) by f = n.d/|d| at the start and the stationary point of d = a + t e."""
    na, aa = dot(n, a), dot(a, a)
    if aa > 0:
        f = na / math.sqrt(aa)
        least, most = min(least, f), max(most, f)
    ne, ae, ee = dot(n, e), dot(a, e), dot(e, e)
    numerator = na * ae - ne * aa
    denominator = ne * ae - na * ee
    # The stationary point is inside the edge when 0 < numerator / denominator < 1.
    if denominator < 0:
        numerator, denominator = -numerator, -denominator
    if 0 < numerator < denominator:
        t = numerator / denominator
        d = (a[0] + t * e[0], a[1] + t * e[1], a[2] + t * e[2])
        dd = dot(d, d)
        if dd > 0:
            f = dot(n, d) / math.sqrt(dd)
            least, most = min(least, f), max(most, f)
    return least, most


@inner
def segment_meets(low, high, d, length):
    """Return whether the segment from the sensor along the unit vector d meets the box."""
    near, far = 0.0, length
    for a, b, along in ((low[0], high[0], d[0]), (low[1], high[1], d[1]), (low[2], high[2], d[2])):
        if along == 0:
            if a > 0 or b < 0:
                return False
        else:
            t0, t1 = a / along, b / along
            near, far = max(near, min(t0, t1)), min(far, max(t0, t1))
    return near <= far


@inner
def sine_range(low, high, n):
    """Return the range of n.d/|d| over a box, up to rounding."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    if x0 <= 0 <= x1 and y0 <= 0 <= y1 and z0 <= 0 <= z1:
        return -1.0, 1.0
    least, most = math.inf, -math.inf
    # Twelve edges; their starts and the two last corners make the eight corners.
    for y in (y0, y1):
        for z in (z0, z1):
            least, most = _widened_by_edge((x0, y, z), (x1 - x0, 0.0, 0.0), n, least, most)
    for x in (x0, x1):
        for z in (z0, z1):
            least, most = _widened_by_edge((x, y0, z), (0.0, y1 - y0, 0.0), n, least, most)
    for x in (x0, x1):
        for y in (y0, y1):
            least, most = _widened_by_edge((x, y, z0), (0.0, 0.0, z1 - z0), n, least, most)
    for z in (z0, z1):
        least, most = _widened_by_edge((x1, y1, z), (0.0, 0.0, 0.0), n, least, most)
    if segment_meets(low, high, n, math.inf):
        most = 1.0
    if segment_meets(low, high, (-n[0], -n[1], -n[2]), math.inf):
        least = -1.0
    return least - _ULPS, most + _ULPS


@inner
def sines_between(sines, low, high):
    """Return the first and past the last of the sorted sines within [low, high]."""
    first = 0
    while first < len(sines) and sines[first] < low:
        first += 1
    last = first
    while last < len(sines) and sines[last] <= high:
        last += 1
    return first, last
