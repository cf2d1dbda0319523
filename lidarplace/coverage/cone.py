"""Exact coverage: the cones that the beams of a turning LiDAR sweep, without azimuth sampling.

As a beam of elevation e turns about the sensor's axis n it sweeps the cone `n.d = sin(e) |d|`
(paper, section 3.1). A voxel is covered when its closed cube, grown by 1e-9 of its edge, meets the
cone of some beam, within the sensor's range and field of view.

Over the square of a column of voxels the cone is the graph of a convex (e > 0) or concave (e < 0)
function of (x, y), so a beam covers one run of z. Columns run along the axis of the grid that is
closest to n. Beams whose cone is not a graph are tested voxel by voxel: the range of `n.d/|d|` over
a cube holds the sine of some beam.

Where range or field of view end within a tile, its voxels are tested against the part of the cone
that is seen. A pattern that does not repeat sweeps no cones; its rays are walked one by one."""

import threading
from dataclasses import replace
from typing import Any

import numpy as np
from cachetools import LRUCache, cached

from lidarplace.base.roi import Roi
from lidarplace.coverage.bits import Bits, empty, exchange_columns, pack
from lidarplace.coverage.cone_columns import Columns, cover_tiles
from lidarplace.coverage.cone_sines import Sensor
from lidarplace.coverage.cone_voxels import keep_seen
from lidarplace.coverage.rays import covered_by_rays
from lidarplace.coverage.tiles import Tiles
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement, blocks

CACHE_BYTES = 2**28
"""Coverage of single sensors that is kept for the next placement; a search moves one at a time."""
_AXES = {0: (1, 2, 0), 1: (0, 2, 1), 2: (0, 1, 2)}  # axes of the grid whose columns run along one


def cone_bits(placement: Placement, roi: Roi, tiles: Tiles) -> Bits:
    """Return voxels that the beams of `placement` cover, right for those that matter by `tiles`."""
    bits = empty(roi.shape)
    for mount, lidar in zip(placement.mounts, placement.lidars, strict=True):
        for block_mount, block, _ in blocks(mount, around(lidar)):
            bits |= sensor_bits(block, block_mount, roi, tiles)
    return bits


def around(lidar: Lidar) -> Lidar:
    """Return the LiDAR without offsets of azimuth, if its cones are whole: they are the same."""
    return replace(lidar, azimuth_offsets=None) if lidar.full_turn else lidar


def _key(lidar: Lidar, mount: Mount, roi: Roi, tiles: Tiles) -> tuple[Any, ...]:
    beams = lidar.elevations if lidar.pattern is None else (lidar.pattern, lidar.frame)
    seen = (beams, lidar.azimuth, lidar.reach)
    return (seen, mount, roi, tiles.lowest.tobytes(), tiles.highest.tobytes())


@cached(
    LRUCache(CACHE_BYTES, getsizeof=lambda bits: bits.nbytes),
    _key,
    condition=threading.Condition(),  # threads wait for a sensor that one of them is covering
)
def sensor_bits(lidar: Lidar, mount: Mount, roi: Roi, tiles: Tiles) -> Bits:
    """Return voxels that one LiDAR covers, right for those that matter by `tiles`; read-only."""
    if lidar.pattern is not None:
        bits = pack(covered_by_rays(Placement("one", [mount], lidar), roi, "dda"))
        bits.flags.writeable = False
        return bits
    sensor = sensor_of(lidar, mount)
    run = int(np.argmax(np.abs(sensor.frame[2])))
    axes = list(_AXES[run])
    nx, ny, nz = (roi.shape[axis] for axis in axes)
    if sensor.frame[2, run] < 0:  # the same sensor with the opposite axis: all but x turns round
        turned_frame = sensor.frame * np.array([[1.0], [-1.0], [-1.0]])
        sines, azimuth = -sensor.sines[::-1], -sensor.azimuth[::-1]
        sensor = sensor._replace(frame=turned_frame, sines=sines, azimuth=azimuth)
    frame = np.ascontiguousarray(sensor.frame[:, axes])
    sensor = sensor._replace(origin=sensor.origin[axes], frame=frame)
    part = tiles.along(run, roi.shape)
    grid = Columns(roi.minimum[axes], roi.resolution, nz, part.lowest, part.highest)
    bits = empty((nx, ny, nz))
    cover_tiles(sensor, grid, bits)
    corners = np.array([roi.x, roi.y, roi.z]) - mount.position[:, None]
    if not lidar.full_turn or lidar.reach < np.linalg.norm(np.abs(corners).max(axis=1)):
        keep_seen(sensor, grid, bits)
    if run != 2:
        bits = exchange_columns(bits, nz)  # from (y, z, x) to (y, x, z), or (x, z, y) to (x, y, z)
        bits = np.ascontiguousarray(bits.swapaxes(1, 2)) if run == 0 else bits
    bits.flags.writeable = False
    return bits


def sensor_of(lidar: Lidar, mount: Mount) -> Sensor:
    """Return one LiDAR as compiled code takes it."""
    sines = np.unique(np.sin(lidar.elevations))
    azimuth = np.array((-np.pi, np.pi) if lidar.full_turn else lidar.azimuth)
    frame = np.ascontiguousarray(mount.rotation.T)
    return Sensor(mount.position, frame, sines, azimuth, lidar.reach)
