"""Which mounts to take out of a finite set of candidates, and how far from the best that can be."""

from lidarplace.pog.selection.exposure import Exposure
from lidarplace.pog.selection.greedy import Greedy, gains, greedy
from lidarplace.pog.selection.limits import Limits
from lidarplace.pog.selection.upper_bound import UpperBound, upper_bound

__all__ = ["Exposure", "Greedy", "Limits", "UpperBound", "gains", "greedy", "upper_bound"]
