"""Choice of mounts from a finite set of candidates, and a bound on every choice."""

from lidarplace.pog.selection.exposure import Exposure
from lidarplace.pog.selection.limits import Limits
from lidarplace.pog.selection.majorant import VoxelChoice
from lidarplace.pog.selection.submodular import Greedy, SubmodularChoice, UpperBound

__all__ = ["Exposure", "Greedy", "Limits", "SubmodularChoice", "UpperBound", "VoxelChoice"]
