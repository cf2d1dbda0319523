"""What is placed around the vehicle: a box that stands on the ground."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

DARK = 0.1
"""Reflectivity of which data sheets tell a range: dark clothes, black paint less."""


@dataclass(frozen=True)
class PlacedObject:
    """A box on the ground, turned to several headings.

    Attributes:
        length, width, height: metres.
        headings: so many, evenly over half a turn; after it a box looks the same.
        object_class: whose detection curve it has; None if it has none.
        reflectivity: share of the light that it sends back, of a LiDAR whose range depends on it.
    """

    length: float
    width: float
    height: float
    headings: int = 4
    object_class: str | None = None
    reflectivity: float = DARK

    @property
    def size(self) -> tuple[float, float, float]:
        """Length, width, height."""
        return self.length, self.width, self.height

    @property
    def angles(self) -> NDArray[np.float64]:
        """The headings, radians from the x axis to the left, shape (headings,)."""
        return np.linspace(0.0, np.pi, self.headings, endpoint=False, dtype=np.float64)

    def boxes(self, points: NDArray[np.float64], heading: float) -> NDArray[np.float64]:
        """Rows of `lidarplace.logs.boxes.GEOMETRY` with the middle at `points`, shape (P, 2)."""
        rows = np.empty((len(points), 7))
        rows[:, :2] = points
        rows[:, 2:] = 0.5 * self.height, *self.size, heading
        return rows


STANDARD = {
    "Car": PlacedObject(4.4, 1.8, 1.6, object_class="Car"),
    "Cyclist": PlacedObject(1.75, 0.6, 1.7, object_class="Cyclist"),
    "Pedestrian": PlacedObject(0.55, 0.6, 1.7, object_class="Pedestrian"),
    "child": PlacedObject(0.35, 0.45, 1.15, object_class="Pedestrian"),
}
"""By name: the middle of the sizes that simulated traffic has (a bicycle for Cyclist), and a child
of six years."""
