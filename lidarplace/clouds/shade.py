"""Where rays of a LiDAR end at other parts of its own rig, the same in every frame."""

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
    """Those of `housings`, without the LiDAR's own, that its rays meet."""
    each = (ends_of(mount, lidar, housing[None]) for housing in housings)
    return housings[np.array([len(ends) > 0 for ends in each], np.bool_)]


def ends_of(
    mount: Mount, lidar: Lidar, housings: NDArray[np.float64], vehicle: Vehicle | None = None
) -> NDArray[np.float64]:
    """The inverse distance, 1/m, at which each ray of a LiDAR ends at a housing or the vehicle's
    mesh.

    0 where it meets none, infinite for a ray that starts inside of a housing; in the order of
    `Lidar.directions()`, shape (rays,); NO_ENDS if none meets any. `housings` are without the
    LiDAR's own; boxes of the vehicle are no matter here."""
    mesh = None if vehicle is None else vehicle.mesh
    ends = np.zeros(lidar.rays)
    for rays, numbers in rays_of(mount, lidar):
        _end_at_housings(*rays, housings, ends[numbers])
        if mesh is not None:
            _end_at_mesh(*rays, mesh.tree, ends[numbers])
    return ends if ends.any() else NO_ENDS


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
def _end_at_housings(origin, rotation, beams, housings, ends):
    steps = beams.azimuths.shape[2]
    for n in range(len(housings)):
        housing = housings[n]
        middle, radius = rotation.T @ (housing[1:4] - origin), np.linalg.norm(housing[13:16])
        away = np.linalg.norm(middle)
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
                if x * middle[0] + y * middle[1] + se * middle[2] >= least:
                    dx, dy, dz = turned(turn, x, y, se)
                    t = enter_housing(place[0], place[1], place[2], dx, dy, dz, housing)
                    ray = beam * steps + step
                    ends[ray] = max(ends[ray], 1.0 / t)
