"""LiDARs of a rig that see nothing of the ROI."""

import numpy as np

from lidarplace.base.errors import InputError
from lidarplace.base.kernel_cache import njit
from lidarplace.base.number_text import point
from lidarplace.base.roi import Roi
from lidarplace.clouds.convex import span
from lidarplace.clouds.own_body import sedan
from lidarplace.clouds.raycast import along, rays_of
from lidarplace.mounting.housing import housing_around, housings_in, turned
from lidarplace.mounting.sight import Obstacles, obstacles_of, stopped
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.placement import Placement

OBJECTS_M = 2.0
"""Height above the ground up to which objects count: higher up are only the tops of trucks."""
SPACE_M = 0.5
"""Least length of a ray in the space of objects; next to the body there is no room for one."""


def blind_lidars(rig: Placement, roi: Roi, vehicle: Vehicle | None) -> list[int]:
    """Return the LiDARs, from 0, that see neither ground nor the space of objects in the ROI.

    One pose of the vehicle in which they do not is enough; None: a sedan.

    A ray sees if it reaches the ground of the ROI, or SPACE_M of it are in the ROI below OBJECTS_M,
    between the least range and the range, before the vehicle or another LiDAR stops it. All rays of
    a LiDAR are fired, of a pattern those of all frames, until one sees."""
    floor = max(roi.z[0], 0.0)
    low = np.array([roi.x[0], roi.y[0], floor])
    high = np.array([roi.x[1], roi.y[1], min(roi.z[1], floor + OBJECTS_M)])
    poses, housings, blind = (vehicle or sedan()).poses, housings_in(rig), []
    obstacles = [obstacles_of(pose, housings) for pose in poses.values()]
    for number, (mount, lidar) in enumerate(zip(rig.mounts, rig.lidars, strict=True)):
        frames = range(1 if lidar.pattern is None else lidar.pattern.frames)
        if not all(
            any(
                _sees(rays, lidar.reach, (low, high), of_pose, number)
                for frame in frames
                for rays, _ in rays_of(mount, lidar.in_frame(frame))
            )
            for of_pose in obstacles
        ):
            blind.append(number)
    return blind


def why_blind(rig: Placement, roi: Roi, number: int) -> tuple[str, str]:
    """Return the reason why a LiDAR is blind, and a remedy."""
    if (around := housing_around(rig, number)) is not None:
        return f"is inside the housing of LiDAR {around + 1}", "move it, or correct size_mm"
    seen = f"nothing below {OBJECTS_M:g} m in the ROI (x {list(roi.x)}, y {list(roi.y)} m)"
    fix = "turn or move it, extend the ROI, or set allow_blind_lidars: true"
    return f"sees no ground and {seen}", fix


def check_not_blind(rig: Placement, roi: Roi, vehicle: Vehicle | None) -> None:
    """Raise ValueError for the first of `blind_lidars`."""
    for number in blind_lidars(rig, roi, vehicle):
        place, (why, fix) = point(*rig.mounts[number].position), why_blind(rig, roi, number)
        raise InputError(f"LiDAR {number + 1} at {place} {why}", place=repr(rig.name), fix=fix)


@njit(cache=True, nogil=True, error_model="numpy")
def _sees(rays, reach, space, obstacles: Obstacles, number):
    """Return whether a ray sees; `space` are lowest and highest corner of what counts."""
    (origin, rotation, beams), (low, high) = rays, space
    for beam in range(len(beams.elevations)):
        _, ce, se = beams.elevations[beam]
        cosines, sines = along(beams, beam)
        for step in range(len(cosines)):
            dx, dy, dz = turned(rotation, ce * cosines[step], ce * sines[step], se)
            enter, leave = beams.nearest, np.inf
            for axis, d in enumerate((dx, dy, dz)):
                near, far = span(origin[axis], d, low[axis], high[axis])
                enter, leave = max(enter, near), min(leave, far)
            grounded = low[2] == 0.0 and dz < 0.0 and leave == -origin[2] / dz
            needed = min(enter + SPACE_M, leave) if grounded else enter + SPACE_M
            long_enough = enter <= leave and needed <= min(leave, reach)
            if long_enough and not stopped(origin, dx, dy, dz, needed, obstacles, number):
                return True
    return False
