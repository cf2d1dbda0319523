"""The training traffic of a search, on which surrogates look at rigs."""

from collections.abc import Mapping
from dataclasses import dataclass

from lidarplace import ExpectedRecall, OccupancyGrid


@dataclass(frozen=True)
class Traffic:
    """What is known of it.

    Attributes:
        grids: POG by class; empty if no surrogate is asked for.
        objects: the objects one by one, for `expected_recall`; None if it is not asked for.
    """

    grids: Mapping[str, OccupancyGrid]
    objects: ExpectedRecall | None = None
