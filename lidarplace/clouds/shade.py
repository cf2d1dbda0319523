"""Ends of the rays of a LiDAR at other parts of its own rig, equal in every frame."""

import math

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import njit
from lidarplace.clouds.raycast import HAIR, NO_ENDS, along, rays_of
from lidarplace.mounting.housing import enter_housing, housings_in, turned, without
from lidarplace.mounting.mesh import first_hit
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement


def in_view(mount: Mount, lidar: Lidar, housings: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the `housings`, without the LiDAR's own, that its rays meet."""
    ends = (ends_of(mount, lidar, housing[None]) for housing in housings)
    return housings[np.array([len(housing_ends) > 0 for housing_ends in ends], np.bool_)]


def ends_of(
    mount: Mount, lidar: Lidar, housings: NDArray[np.float64], vehicle: Vehicle | None = None
) -> NDArray[np.float64]:
    """Return inverse distances, 1/m, at which rays end at a housing or the vehicle's mesh.

    They are 0 where a ray meets none, infinite for a ray that starts inside of a housing; in the
    order of `Lidar.directions()`, shape (rays,); NO_ENDS if none meets any. `housings` are without
    the LiDAR's own; boxes of the vehicle do not matter here."""
    mesh = None if vehicle is None else vehicle.mesh
    if mesh is None and not len(housings):
        return NO_ENDS
    ends = np.zeros(lidar.rays)
    for rays, numbers in rays_of(mount, lidar):
        _end_at_housings(rays, housings, ends[numbers])
        if mesh is not None:
            _end_at_mesh(rays, mesh.tree, ends[numbers])
    return ends if ends.any() else NO_ENDS


def ends_in_rig(placement: Placement, vehicle: Vehicle | None = None) -> list[NDArray[np.float64]]:
    """Return `ends_of` every LiDAR of a rig."""
    housings, lidars = housings_in(placement), enumerate(placement.lidars)
    mounts = placement.mounts
    return [ends_of(mounts[n], lidar, without(housings, n), vehicle) for n, lidar in lidars]


@njit(cache=True, nogil=True, error_model="numpy")
def _end_at_mesh(rays, tree, ends):
    origin, rotation, beams = rays
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
def _end_at_housings(rays, housings, ends):
    origin, rotation, beams = rays
    steps = beams.azimuths.shape[2]
    for n in range(len(housings)):
        housing = housings[n]
        centre, radius = rotation.T @ (housing[1:4] - origin), np.linalg.norm(housing[13:16])
        away = np.linalg.norm(centre)
        if away - radius > beams.reach:
            continue
        # Rays that may meet the sphere around it, unless they start in it.
        tangent = math.sqrt(max(float(away * away - radius * radius), 0.0)) - HAIR * away
        least = tangent if away > radius else -np.inf
        into = housing[4:13].copy().reshape(3, 3).T  # from the ego frame to that of the housing
        place, turn = into @ (origin - housing[1:4]), into @ rotation
        for beam in range(len(beams.elevations)):
            _, ce, se = beams.elevations[beam]
            cosines, sines = along(beams, beam)
            for step in range(steps):
                x, y = ce * cosines[step], ce * sines[step]
                if x * centre[0] + y * centre[1] + se * centre[2] >= least:
                    dx, dy, dz = turned(turn, x, y, se)
                    t = enter_housing(place[0], place[1], place[2], dx, dy, dz, housing)
                    ray = beam * steps + step
                    ends[ray] = max(ends[ray], 1.0 / t)
