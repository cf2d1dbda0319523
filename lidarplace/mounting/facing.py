"""Pairs of LiDARs: how far apart they are, and which look into each other, so that the light of one
blinds or deceives the other."""

import math
from itertools import combinations

from lidarplace.mounting.field_of_view import in_view, views_of
from lidarplace.mounting.housing import housings_in, without
from lidarplace.mounting.sight import obstacles_of, stopped
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.placement import Placement

BAND_M = 50e-9
"""Filters before detectors keep out light of wavelengths that differ by more."""


def facing_pairs(placement: Placement, vehicle: Vehicle) -> list[tuple[int, int]]:
    """Numbers, from 0, of pairs each of which has the other in its field of view and in sight.
    Body, keep-outs and housings of further LiDARs hide one from the other. A field of view goes
    from the lowest to the highest beam: whether a beam meets the window is left to tolerances."""
    views, obstacles = views_of(placement), obstacles_of(vehicle, housings_in(placement))
    found = []
    for i, j in combinations(range(len(views)), 2):
        one, other = views[i], views[j]
        dx, dy, dz = (other.origin - one.origin).tolist()
        apart = abs(placement.lidars[i].wavelength - placement.lidars[j].wavelength)
        between = obstacles._replace(housings=without(without(obstacles.housings, i), j))
        if (
            apart <= BAND_M
            and in_view(one, *other.origin)
            and in_view(other, *one.origin)
            and not stopped(one.origin, dx, dy, dz, 1.0, between, i)
        ):
            found.append((i, j))
    return found


def least_distance(placement: Placement) -> float:
    """Between the positions of the two closest LiDARs, metres; `inf` for a single one."""
    places = [(mount.x, mount.y, mount.z) for mount in placement.mounts]
    return min((math.dist(a, b) for a, b in combinations(places, 2)), default=math.inf)
