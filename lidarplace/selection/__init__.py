"""Which mounts to take out of a finite set of candidates, and how far from the best that can be."""

from lidarplace.selection.exposure import Exposure
from lidarplace.selection.greedy import Greedy, gains, greedy
from lidarplace.selection.limits import Limits
from lidarplace.selection.upper_bound import UpperBound, upper_bound

__all__ = ["Exposure", "Greedy", "Limits", "UpperBound", "gains", "greedy", "upper_bound"]
