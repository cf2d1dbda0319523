"""Where rays of a LiDAR end at other parts of its own rig, the same in every frame."""

import math

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import njit
from lidarplace.clouds.raycast import HAIR, NO_ENDS, Beams, along, beams_in, rays_of, runs
from lidarplace.mounting.housing import enter_housing, housings_in, turned, without
from lidarplace.mounting.mesh import first_hit
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement


def in_view(mount: Mount, lidar: Lidar, housings: NDArray[np.float64]) -> NDArray[np.float64]:
    """Those of `housings`, without the LiDAR's own, that its rays may meet, and perhaps others
    nearby."""
    if not len(housings):
        return housings
    seen = [_windows(*rays, housings)[:, 0] > 0 for rays, _ in rays_of(mount, lidar)]
    return housings[np.logical_or.reduce(seen)]


def ends_of(
    mount: Mount, lidar: Lidar, housings: NDArray[np.float64], vehicle: Vehicle | None = None
) -> NDArray[np.float64]:
    """The inverse distance, 1/m, at which each ray of a LiDAR ends at a housing or the vehicle's
    mesh.

    0 where it meets none, infinite for a ray that starts inside of a housing; in the order of
    `Lidar.directions()`, shape (rays,); or NO_ENDS. `housings` are without the LiDAR's own; boxes
    of the vehicle are no matter here."""
    near = in_view(mount, lidar, housings)
    mesh = None if vehicle is None else vehicle.mesh
    if mesh is None and not len(near):
        return NO_ENDS
    ends = np.zeros(lidar.rays)
    for rays, numbers in rays_of(mount, lidar):
        _end_at_housings(*rays, near, ends[numbers])
        if mesh is not None:
            _end_at_mesh(*rays, mesh.tree, ends[numbers])
    return ends


def ends_in_rig(placement: Placement, vehicle: Vehicle | None = None) -> list[NDArray[np.float64]]:
    """`ends_of` every LiDAR of a rig."""
    housings, lidars = housings_in(placement), enumerate(placement.lidars)
    return [ends_of(placement.mounts[n], own, without(housings, n), vehicle) for n, own in lidars]


@njit(cache=True, nogil=True, error_model="numpy")
def _end_at_mesh(origin, rotation, beams, tree, ends):
    steps = beams.azimuths.shape[2]
    for beam in range(len(beams.elevations)):
        _, ce, se = beams.elevations[beam]
        cosines, sines = along(beams, beam)
        for step in range(steps):
            dx, dy, dz = turned(rotation, ce * cosines[step], ce * sines[step], se)
            t = first_hit(origin, dx, dy, dz, beams.reach, tree)
            if t < beams.reach:
                ray = beam * steps + step
                ends[ray] = max(ends[ray], 1.0 / t)


@njit(cache=True, nogil=True, error_model="numpy")
def _windows(origin, rotation, beams: Beams, housings) -> NDArray[np.float64]:
    """Whether the sphere around each housing meets a beam, its azimuth and half width, its least
    and greatest elevation, radians, in the sensor's frame; shape (n, 5)."""
    found = np.zeros((len(housings), 5))
    lowest, highest = beams.elevations[:, 0].min(), beams.elevations[:, 0].max()
    for n in range(len(housings)):
        row = housings[n]
        radius = math.sqrt(row[13] ** 2 + row[14] ** 2 + row[15] ** 2)
        seen = rotation.T @ (row[1:4] - origin)
        away = math.sqrt(seen[0] ** 2 + seen[1] ** 2 + seen[2] ** 2)
        if away - radius > beams.reach:
            continue
        half, low, high = math.pi, -math.pi, math.pi
        if away > radius:
            wide, up = math.asin(radius / away), math.asin(min(max(seen[2] / away, -1.0), 1.0))
            low, high = up - wide - HAIR, up + wide + HAIR
            if abs(up) + wide < 0.5 * math.pi - HAIR:
                half = math.asin(min(math.sin(wide) / math.cos(up), 1.0)) + HAIR
        found[n, 1], found[n, 2] = math.atan2(seen[1], seen[0]), half
        found[n, 3], found[n, 4] = low, high
        if low > highest or high < lowest:
            continue
        if len(beams.aimed):
            first, last = beams_in(beams, found[n, 1], half, half)
            found[n, 0] = first < last
            continue
        one, other = runs(beams, 0, found[n, 1], half, half)  # all beams fire at equal azimuths
        found[n, 0] = one[0] < one[1] or other[0] < other[1]
    return found


@njit(cache=True, nogil=True, error_model="numpy")
def _end_at_housings(origin, rotation, beams, housings, ends):
    windows = _windows(origin, rotation, beams, housings)
    steps = beams.azimuths.shape[2]
    for n in range(len(housings)):
        housing = housings[n]
        into = housing[4:13].copy().reshape(3, 3).T  # from the ego frame to that of the housing
        place, turn = into @ (origin - housing[1:4]), into @ rotation
        for beam in range(*beams_in(beams, windows[n, 1], windows[n, 2], windows[n, 2])):
            elevation, ce, se = beams.elevations[beam]
            if not windows[n, 3] <= elevation <= windows[n, 4]:
                continue
            cosines, sines = along(beams, beam)
            for first, last in runs(beams, beam, windows[n, 1], windows[n, 2], windows[n, 2]):
                for step in range(first, last):
                    dx, dy, dz = turned(turn, ce * cosines[step], ce * sines[step], se)
                    t = enter_housing(place[0], place[1], place[2], dx, dy, dz, housing)
                    ray = beam * steps + step
                    ends[ray] = max(ends[ray], 1.0 / t)
