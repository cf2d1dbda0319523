"""Pairs of LiDARs that look into each other: the light of one disturbs the other."""

from itertools import combinations

from lidarplace.mounting.field_of_view import in_view, views_of
from lidarplace.mounting.housing import housings_in, without
from lidarplace.mounting.sight import obstacles_of, stopped
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.placement import Placement

BAND_M = 50e-9
"""Difference of wavelengths beyond which filters before detectors keep out light, metres."""


def facing_pairs(placement: Placement, vehicle: Vehicle) -> list[tuple[int, int]]:
    """Return pairs of LiDARs each of which has the other in its field of view and in sight.

    Numbers from 0. Body, keep-outs and housings of further LiDARs hide one from the other. A field
    of view goes from the lowest to the highest beam: whether a beam meets the window is left to
    tolerances."""
    views, obstacles = views_of(placement), obstacles_of(vehicle, housings_in(placement))
    pairs = []
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
            pairs.append((i, j))
    return pairs
