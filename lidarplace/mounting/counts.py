"""Bounds on the number of LiDARs of a rig: in all, in a zone, of a model."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Protocol

from lidarplace.mounting.limits import ROUNDING
from lidarplace.mounting.zone import Zone


class NamedLidar(Protocol):
    """A LiDAR with the names of its zone and its model."""

    @property
    def zone(self) -> str:
        """Name of the zone."""

    @property
    def model(self) -> str:
        """Name of the model."""


@dataclass(frozen=True)
class CountBound:
    """Least and greatest number of LiDARs of a zone or a model, or of all.

    Attributes:
        key: of the configuration, such as `zones.roof.lidars`.
        low: least number.
        high: greatest number.
        zone: name of the zone; None: any.
        model: name of the model; None: any.
        size: LiDARs that count as one, 2 in a zone of mirrored pairs."""

    key: str
    low: int
    high: int
    zone: str | None = None
    model: str | None = None
    size: int = 1

    @property
    def text(self) -> str:
        """The bound as a configuration has it."""
        return f"{self.low}" if self.low == self.high else f"[{self.low}, {self.high}]"

    def number(self, lidars: Iterable[NamedLidar]) -> int:
        """Count the LiDARs that the bound is for; a pair counts as one where `size` is 2."""
        counted = sum(
            self.zone in (None, lidar.zone) and self.model in (None, lidar.model)
            for lidar in lidars
        )
        return counted // self.size

    def less(self, number: int) -> "CountBound":
        """Return the bound of the others, where so many are there."""
        return replace(self, low=self.low - number, high=self.high - number)

    def allows(self, number: int) -> bool:
        """Return whether a number is within the bound."""
        return self.low <= number <= self.high


def most_in_zone(zone: Zone, distance: float) -> float:
    """Return a number of LiDARs that a zone cannot exceed, if they are `distance` metres apart.

    The box around the zone is divided into cells whose diagonal is `distance`: each holds one
    LiDAR. Exact for a point and a line."""
    ys = [y for _, y in zone.polygon]
    spans = (zone.x, (min(ys), max(ys)), zone.z)
    lengths = [high - low for low, high in spans if high > low]
    if not distance:
        return math.inf if lengths else 1
    edge = distance / math.sqrt(max(1, len(lengths)))
    return math.prod(math.floor((length + ROUNDING) / edge) + 1 for length in lengths)
