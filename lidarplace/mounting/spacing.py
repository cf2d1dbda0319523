"""How far apart the LiDARs of a placement sit."""

import math
from itertools import combinations

from lidarplace.rigs.placement import Placement


def least_distance(placement: Placement) -> float:
    """Between the positions of the two closest LiDARs, metres; `inf` for a single one."""
    places = [(mount.x, mount.y, mount.z) for mount in placement.mounts]
    return min((math.dist(a, b) for a, b in combinations(places, 2)), default=math.inf)
