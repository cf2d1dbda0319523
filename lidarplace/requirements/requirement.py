"""A requirement: what must be seen where, how much of it, and in which further cases."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.base.roi import Interval
from lidarplace.mounting.common_view import CommonView
from lidarplace.mounting.errors import MountingErrors
from lidarplace.recall.detection_curve import CELL_M, DetectionCurve
from lidarplace.requirements.area import Area
from lidarplace.rigs.further_sensors import Kind
from lidarplace.rigs.placement import Placement
from lidarplace.rigs.weather import Weather

DARK = 0.1  # reflectivity of which data sheets tell a range: dark clothes, black paint less


@dataclass(frozen=True)
class PlacedObject:
    """A box on the ground, turned to several headings; metres."""

    length: float
    width: float
    height: float
    headings: int = 4  # evenly over half a turn; after it a box looks the same
    object_class: str | None = None  # whose detection curve it has
    reflectivity: float = DARK  # share of the light that it sends back

    @property
    def size(self) -> tuple[float, float, float]:
        """Length, width, height."""
        return self.length, self.width, self.height

    @property
    def angles(self) -> NDArray[np.float64]:
        """The headings, radians from the x axis to the left, shape (headings,)."""
        return np.linspace(0.0, np.pi, self.headings, endpoint=False, dtype=np.float64)

    def boxes(self, points: NDArray[np.float64], heading: float) -> NDArray[np.float64]:
        """Return rows of `lidarplace.logs.boxes.GEOMETRY` with the middle at `points`, (P, 2)."""
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
"""Standard objects by name: the middle of the sizes that simulated traffic has (a bicycle for
Cyclist), and a child of six years."""


AS_BUILT = "as built"

Measure = Literal[
    "points", "cells", "probability", "coverage", "pixels", "reach", "common view", "times the need"
]
KIND_OF: dict[Measure, Kind] = {"pixels": "camera", "reach": "radar"}
"""Kind of sensor that has a measure; other measures are of LiDARs."""


def measured(measure: Measure, sensors: int | None, kinds: int) -> str:
    """Describe a measure, and by how many sensors it is needed, for tables."""
    if sensors is None or (sensors == 1 and measure in KIND_OF):
        return measure
    of = f" of {kinds} kinds" if kinds > 1 else ""
    return f"{measure} by {sensors} sensor{'s'[: sensors > 1]}{of}"


MOST_DEAD = 1000  # sets of dead sensors of one rig


def dead_sets(dead: int, sensors: int) -> list[tuple[int, ...]]:
    """Return all sets of `dead` dead sensors of a rig; all of them if it has no more.

    Raises ValueError: there are too many sets."""
    dead = min(dead, sensors)
    if (sets := math.comb(sensors, dead)) > MOST_DEAD:
        most = f"at most {MOST_DEAD:,} sets of {dead} dead sensors"
        number = f"{sets:,} of {sensors} sensors"
        raise InputError(expected=most, found=number, fix="lower sensors_dead")
    return list(combinations(range(sensors), dead))


@dataclass(frozen=True)
class AlsoWhen:
    """Further cases in which a requirement holds; each by itself, the rig otherwise as built.

    None, False and 0: no such case."""

    one_lidar_dead: bool = False  # any one of the LiDARs sees nothing
    range_factor: float | None = None  # every LiDAR reaches so much of its range
    weather: Weather | None = None
    mounts_off: MountingErrors | None = None  # at most; each rig that is drawn is a case
    draws: int = 0
    sensors_dead: int = 0  # any so many of the sensors see nothing

    def left(self, names: Sequence[str], lidars: int) -> dict[str, list[int]]:
        """Return numbers of the sensors that are not dead, by case; first "", in which none is.

        `names` has the LiDARs first, and `lidars` of them. Raises ValueError as `dead_sets`."""
        sets = dead_sets(1, lidars) if self.one_lidar_dead else []
        sets += dead_sets(self.sensors_dead, len(names)) if self.sensors_dead else []
        dead = {"": ()} | {f"without {' and '.join(names[n] for n in some)}": some for some in sets}
        every = range(len(names))
        return {label: [n for n in every if n not in some] for label, some in dead.items()}

    def variants(self, placement: Placement) -> dict[str, Placement]:
        """Return the rig by case, without those of dead sensors.

        They follow from the rig as built."""
        rigs = {AS_BUILT: placement}
        if self.range_factor is not None:
            shorter = [lidar.nearsighted(self.range_factor) for lidar in placement.lidars]
            rigs[f"range × {self.range_factor:g}"] = placement.with_lidar(shorter)
        if self.weather is not None:
            rigs[str(self.weather)] = placement.in_weather(self.weather)
        if self.mounts_off is not None:
            for draw in range(self.draws):
                rigs[f"mounts off, draw {draw + 1}"] = self.mounts_off.drawn(placement, draw)
        return rigs


@dataclass(frozen=True)
class Requirement:
    """A requirement: what must be seen, and where."""

    name: str
    area: Area  # where the middle of the object is; of coverage the ground plan of the volume
    measure: Measure
    """What is counted: returns from the object, distinct cells of its surface, the probability that
    a detector finds it, the share of a volume that is seen, pixels of a camera, the reach of a
    radar as a multiple of the distance, or the share of a field of view that another sensor sees,
    too."""
    least: float  # so much of it is needed
    placed: PlacedObject | None = None  # None for coverage and common view
    share: float = 1.0  # of the area that needs to have it; 1: the worst place, too
    step: float = 0.25  # between positions, or edge of a voxel; metres
    heights: Interval = (0.0, 2.0)  # of the volume of coverage, metres
    curve: DetectionCurve | None = None  # for a probability
    cell: float = CELL_M  # edge of a cell of the surface, metres
    also_when: AlsoWhen = AlsoWhen()
    sensors: int | None = None  # so many have to have it, each by itself; None: LiDARs together
    common_view: CommonView | None = None  # of pairs of sensors, in place of an area
    kinds: int = 1  # of so many kinds: LiDARs, cameras, radars
    needs: tuple[tuple[Measure, float], ...] = ()
    """Of several kinds what each of them needs, in place of `least`, which is 1 then."""

    @property
    def measured(self) -> str:
        """The measure, and by how many sensors it is needed, for tables."""
        return measured(self.measure, self.sensors, self.kinds)

    def multiple(self, value: float, factor: float) -> float:
        """Return a multiple of a value; of a probability that of a multiple of its cells."""
        if self.curve is None:
            return value * factor
        return float(self.curve.probability(self.curve.cells(value) * factor))
