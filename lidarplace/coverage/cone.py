"""Exact coverage: the cones that the beams of a turning LiDAR sweep, without azimuth sampling.

As a beam of elevation e turns about the sensor's axis n it sweeps the cone `n.d = sin(e) |d|`
(paper, section 3.1). A voxel is covered when its closed cube meets the cone of some beam.

Two algorithms agree to the last voxel:

- by column: over the square of a column of voxels the cone is the graph of a convex (e > 0) or
  concave (e < 0) function of (x, y), so a beam covers one run of z. Holds while the cone is a
  graph over the plane, that is while `sin(e)^2 < n_z^2`;
- by voxel: the range of `n.d/|d|` over a cube holds the sine of some beam. Always holds.

The first one is used where it holds, the second where it does not.

"Closed" is meant up to rounding: cubes are grown by 1e-9 of their edge. So a cube that a cone
touches in exact arithmetic is covered, though its corner is not representable in binary.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lidarplace.placement import Mount, Placement
from lidarplace.roi import Roi
from lidarplace.sensor import Lidar


def covered_by_cones(placement: Placement, roi: Roi) -> NDArray[np.bool_]:
    """Voxels that the beams of `placement` cover, shape (nx, ny, nz).

    Raises:
        ValueError: the range of the LiDAR ends within the ROI; use `dda` for such a sensor.
    """
    check_range(placement, roi)
    covered = np.zeros(roi.shape, np.bool_)
    for mount in placement.mounts:
        axis, sines = _axis_and_sines(placement.lidar, mount)
        _cover_columns(mount.position, axis, sines, roi.minimum, roi.resolution, covered)
    return covered


def covered_voxel_by_voxel(placement: Placement, roi: Roi) -> NDArray[np.bool_]:
    """The same as `covered_by_cones`, by the test of every single voxel: slower, always valid."""
    check_range(placement, roi)
    covered = np.zeros(roi.shape, np.bool_)
    for mount in placement.mounts:
        axis, sines = _axis_and_sines(placement.lidar, mount)
        _cover_voxels(mount.position, axis, sines, roi.minimum, roi.resolution, covered)
    return covered


def _axis_and_sines(lidar: Lidar, mount: Mount) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Axis n with n_z >= 0 and the sorted sines of the beams; (n, s) and (-n, -s) are one cone."""
    axis = mount.rotation[:, 2]
    sines = np.unique(np.sin(lidar.elevations))
    if axis[2] < 0:
        return -axis, -sines[::-1]
    return axis, sines


def check_range(placement: Placement, roi: Roi) -> None:
    """Raise ValueError if the range of the LiDAR ends within the ROI for one of the mounts."""
    corners = np.array([roi.x, roi.y, roi.z])
    for mount in placement.mounts:
        reach = np.abs(corners - mount.position[:, None]).max(axis=1)
        farthest = float(np.linalg.norm(reach))
        if placement.lidar.range < farthest:
            raise ValueError(
                f"coverage by cones needs a LiDAR range that reaches the whole ROI, "
                f"{farthest:.4g} m from the mount at ({mount.x}, {mount.y}, {mount.z}), "
                f"found {placement.lidar.range:g} m; method 'dda' takes a shorter range"
            )


@njit(cache=True)
def _edge(ax, ay, az, ex, ey, ez, n0, n1, n2, low, high):  # pragma: no cover - compiled
    """Widen (low, high) by f = n.d/|d| at the start and the stationary point of d = a + t e."""
    na = n0 * ax + n1 * ay + n2 * az
    aa = ax * ax + ay * ay + az * az
    if aa > 0:
        f = na / math.sqrt(aa)
        low, high = min(low, f), max(high, f)
    ne = n0 * ex + n1 * ey + n2 * ez
    ae = ax * ex + ay * ey + az * ez
    ee = ex * ex + ey * ey + ez * ez
    numerator = na * ae - ne * aa
    denominator = ne * ae - na * ee
    # The stationary point is inside the edge when 0 < numerator / denominator < 1.
    if denominator < 0:
        numerator, denominator = -numerator, -denominator
    if 0 < numerator < denominator:
        t = numerator / denominator
        x, y, z = ax + t * ex, ay + t * ey, az + t * ez
        dd = x * x + y * y + z * z
        if dd > 0:
            f = (n0 * x + n1 * y + n2 * z) / math.sqrt(dd)
            low, high = min(low, f), max(high, f)
    return low, high


@njit(cache=True)
def _pierced(x0, x1, y0, y1, z0, z1, dx, dy, dz):  # pragma: no cover - compiled
    """Whether the ray from the origin along (dx, dy, dz) meets the box."""
    near, far = 0.0, math.inf
    for a, b, d in ((x0, x1, dx), (y0, y1, dy), (z0, z1, dz)):
        if d == 0:
            if a > 0 or b < 0:
                return False
        else:
            t0, t1 = a / d, b / d
            near, far = max(near, min(t0, t1)), min(far, max(t0, t1))
    return near <= far


@njit(cache=True)
def _sine_range(x0, x1, y0, y1, z0, z1, n0, n1, n2):  # pragma: no cover - compiled
    """Range of n.d/|d| over a box, relative to the sensor."""
    if x0 <= 0 <= x1 and y0 <= 0 <= y1 and z0 <= 0 <= z1:
        return -1.0, 1.0
    low, high = math.inf, -math.inf
    lx, ly, lz = x1 - x0, y1 - y0, z1 - z0
    # Twelve edges; their starts and the two last corners make the eight corners.
    for y in (y0, y1):
        for z in (z0, z1):
            low, high = _edge(x0, y, z, lx, 0.0, 0.0, n0, n1, n2, low, high)
    for x in (x0, x1):
        for z in (z0, z1):
            low, high = _edge(x, y0, z, 0.0, ly, 0.0, n0, n1, n2, low, high)
    for x in (x0, x1):
        for y in (y0, y1):
            low, high = _edge(x, y, z0, 0.0, 0.0, lz, n0, n1, n2, low, high)
    for z in (z0, z1):
        low, high = _edge(x1, y1, z, 0.0, 0.0, 0.0, n0, n1, n2, low, high)
    if _pierced(x0, x1, y0, y1, z0, z1, n0, n1, n2):
        high = 1.0
    if _pierced(x0, x1, y0, y1, z0, z1, -n0, -n1, -n2):
        low = -1.0
    return low, high


@njit(cache=True)
def _height(x, y, s, k, n0, n1, n2):  # pragma: no cover - compiled
    """z of the cone over (x, y), with k = n2^2 - s^2 > 0 and n2 > 0."""
    a = n0 * x + n1 * y
    rr = x * x + y * y
    root = s * math.sqrt(a * a + k * rr)
    if s * a > 0:  # the two terms would cancel
        return (s * s * rr - a * a) / (root + n2 * a)
    return (root - n2 * a) / k


@njit(cache=True)
def _height_range(x0, x1, y0, y1, s, k, n0, n1, n2):  # pragma: no cover - compiled
    """Range of the cone's z over a rectangle: corners, stationary points of the edges, apex."""
    low, high = math.inf, -math.inf
    for x in (x0, x1):
        for y in (y0, y1):
            z = _height(x, y, s, k, n0, n1, n2)
            low, high = min(low, z), max(high, z)
    if x0 <= 0 <= x1 and y0 <= 0 <= y1:
        low, high = min(low, 0.0), max(high, 0.0)
    # With |n| = 1, dz/dx = 0 on y = c where
    # (n0^2 + k) x + n0 n1 c = sign(s n0) n2 |n0 c| sqrt((1 - s^2) / (s^2 - n0^2)).
    # The same on x = c with n0 and n1 exchanged.
    if s * s > n0 * n0:
        slope = math.copysign(1.0, s) * n0 * n2 * math.sqrt((1 - s * s) / (s * s - n0 * n0))
        for y in (y0, y1):
            x = (slope * abs(y) - n0 * n1 * y) / (n0 * n0 + k)
            if x0 < x < x1:
                z = _height(x, y, s, k, n0, n1, n2)
                low, high = min(low, z), max(high, z)
    if s * s > n1 * n1:
        slope = math.copysign(1.0, s) * n1 * n2 * math.sqrt((1 - s * s) / (s * s - n1 * n1))
        for x in (x0, x1):
            y = (slope * abs(x) - n0 * n1 * x) / (n1 * n1 + k)
            if y0 < y < y1:
                z = _height(x, y, s, k, n0, n1, n2)
                low, high = min(low, z), max(high, z)
    return low, high


@njit(cache=True)
def _sides(index, minimum, resolution, origin, grow):  # pragma: no cover - compiled
    """Lower and upper face of a voxel on one axis, relative to the sensor, grown by a hair."""
    low = minimum + index * resolution - origin
    return low - grow, minimum + (index + 1) * resolution - origin + grow


@njit(cache=True)
def _cover_one_by_one(x0, x1, y0, y1, minimum, resolution, origin, axis, sines, column):
    """Test every voxel of one column that is not covered yet; x and y relative to the sensor."""
    for v in range(len(column)):
        if not column[v]:
            z0, z1 = _sides(v, minimum, resolution, origin, 1e-9 * resolution)
            low, high = _sine_range(x0, x1, y0, y1, z0, z1, axis[0], axis[1], axis[2])
            b = np.searchsorted(sines, low)
            column[v] = b < len(sines) and sines[b] <= high


@njit(cache=True)
def _cover_columns(origin, axis, sines, minimum, resolution, covered):  # pragma: no cover
    nx, ny, nz = covered.shape
    n0, n1, n2 = axis
    grow = 1e-9 * resolution
    z0, z1 = minimum[2] - origin[2], minimum[2] + nz * resolution - origin[2]
    for i in range(nx):
        x0, x1 = _sides(i, minimum[0], resolution, origin[0], grow)
        for j in range(ny):
            y0, y1 = _sides(j, minimum[1], resolution, origin[1], grow)
            low, high = _sine_range(x0, x1, y0, y1, z0 - grow, z1 + grow, n0, n1, n2)
            first = np.searchsorted(sines, low)
            last = np.searchsorted(sines, high, side="right")
            graph_everywhere = True
            for b in range(first, last):
                s = sines[b]
                k = n2 * n2 - s * s
                if k < 1e-6:  # no graph, or too steep to compute with
                    graph_everywhere = False
                    continue
                bottom, top = _height_range(x0, x1, y0, y1, s, k, n0, n1, n2)
                k0 = max(0.0, math.ceil((bottom - z0 - grow) / resolution) - 1)
                k1 = min(nz - 1.0, math.floor((top - z0 + grow) / resolution))
                if k1 >= k0:
                    covered[i, j, int(k0) : int(k1) + 1] = True
            if not graph_everywhere:
                _cover_one_by_one(
                    *(x0, x1, y0, y1, minimum[2], resolution, origin[2]),
                    *(axis, sines, covered[i, j]),
                )


@njit(cache=True)
def _cover_voxels(origin, axis, sines, minimum, resolution, covered):  # pragma: no cover
    nx, ny, _ = covered.shape
    grow = 1e-9 * resolution
    for i in range(nx):
        x0, x1 = _sides(i, minimum[0], resolution, origin[0], grow)
        for j in range(ny):
            y0, y1 = _sides(j, minimum[1], resolution, origin[1], grow)
            _cover_one_by_one(
                *(x0, x1, y0, y1, minimum[2], resolution, origin[2]),
                *(axis, sines, covered[i, j]),
            )
