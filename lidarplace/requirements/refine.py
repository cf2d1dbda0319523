"""Values of an object all over an area, in parts that are split where a verdict is near.

A ray that hits what is common to the boxes at all places of a part hits each of them: what this
small box has is a lower bound for the part. The box around all of them gives an upper bound. For
points of LiDARs these bounds are exact but for the minimum range; for other measures they are
close."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from lidarplace.requirements.layout import MOST_OBJECTS, RequirementLayout
from lidarplace.requirements.parts import Parts
from lidarplace.requirements.requirement import Requirement

Measure = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Values of boxes, rows of `lidarplace.logs.boxes.GEOMETRY`, shape (B, sets)."""

SIGMAS = 4.0
"""Standard deviations of the interval of a share."""

_HAIR = 1e-9  # share of the area that rounding may move


@dataclass(frozen=True, eq=False)
class PartValues:
    """Values of parts of an area by sets of sensors, of the worst heading in each.

    Attributes:
        values: at the places of the parts, shape (N, sets); infinite where no object fits.
        headings: numbers of the worst headings, shape (N, sets).
        low: lower bounds over the parts, -inf where not computed, shape (N, sets).
        high: upper bounds over the parts, inf where not computed, shape (N, sets)."""

    parts: Parts
    values: NDArray[np.float64]
    headings: NDArray[np.intp]
    low: NDArray[np.float64]
    high: NDArray[np.float64]

    @property
    def weights(self) -> NDArray[np.float64]:
        """Weights of the parts by set, shape (N, sets); equal ones if no part has any."""
        fits = np.isfinite(self.values)
        weights = np.where(fits, self.parts.weights[:, None], 0.0)
        return weights if weights.any() else fits.astype(np.float64)

    def select(self, rows: NDArray[np.bool_]) -> PartValues:
        """Select some of the parts."""
        parts, *columns = (getattr(self, field.name) for field in fields(self))
        return PartValues(parts.select(rows), *(column[rows] for column in columns))

    def places(self) -> PartValues:
        """Return the places of the parts alone: without area, and without doubt."""
        parts = self.parts._replace(weights=np.zeros(len(self.values)))
        return PartValues(parts, self.values, self.headings, self.values, self.values)

    def joined(self, before: PartValues | None) -> PartValues:
        """Return the parts of both."""
        if before is None:
            return self
        pairs = [[getattr(of, field.name) for of in (before, self)] for field in fields(self)]
        parts = Parts(*map(np.concatenate, zip(*pairs[0], strict=True)))
        return PartValues(parts, *map(np.concatenate, pairs[1:]))


@dataclass(frozen=True, eq=False)
class AreaVerdict:
    """Verdict on an area by one set of sensors.

    Attributes:
        value: value that the share that counts has at least; below the need unless it is met.
        enough: share of the area that has enough.
        undecided: width of the interval of that share if the limit is in it, else 0.
        worst: number of the worst part.
        least: least value of each part, shape (N,)."""

    value: float
    enough: float
    undecided: float
    worst: int
    least: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Refinement:
    """Values of the object of a requirement around one pose of its vehicle.

    `origins`: where the sensors are, metres, shape (sensors, 3)."""

    layout: RequirementLayout
    pose: str
    measure: Measure
    origins: NDArray[np.float64]

    @property
    def need(self) -> float:
        """Least value."""
        return self.layout.requirement.least

    @property
    def share(self) -> float:
        """Share of the area that needs it."""
        return self.layout.requirement.share

    def values(self) -> PartValues | None:
        """Measure the object all over the area; None if it fits nowhere.

        If values at the positions, and bounds around them, leave a verdict open, parts that are
        near the need are split, down to `FINEST_M`, or until there are MOST_OBJECTS."""
        if (objects := self.layout.fields.get(self.pose)) is None:
            return None
        finest, parts, boxes, leaves = objects.finest, objects.parts, objects.boxes, None
        for level in range(finest.levels + 1):
            field = self._measured(parts, boxes)
            free, half = ~np.isnan(boxes[:, :, 0]), finest.half(level)
            for both in (False, True):
                whole = field.joined(leaves)
                self._bound(field, free, half, level == finest.levels, self._sides(whole, both))
            whole = field.joined(leaves)
            near = ~((field.low >= self.need) | (field.high < self.need))
            near &= np.isfinite(field.values) & self._open(whole)
            split = np.asarray(near.any(axis=1))
            if level == finest.levels or not split.any():
                break
            parts = finest.split(field.parts.select(split), level + 1)
            if (len(parts.weights) + len(whole.values)) * len(boxes) > MOST_OBJECTS:
                break
            leaves = field.select(~split).joined(field.select(split).places().joined(leaves))
            boxes = self.layout.boxes_at(parts.points, self.pose)
        return whole

    def verdict(self, field: PartValues, number: int) -> AreaVerdict:
        """Return the verdict of the set `number`."""
        values, weights = field.values[:, number], field.weights[:, number]
        low, high = (ends[number] for ends in self._interval(field))
        enough, share, undecided = float((weights * (values >= self.need)).sum()), self.share, 0.0
        enough /= weights.sum()
        if self._open(field)[number]:
            enough, share, undecided = low, share + enough - low, high - low
        if undecided and share >= 1.0:
            values = np.minimum(values, np.maximum(field.low[:, number], 0.0))
        order = np.argsort(values, kind="stable")[: np.isfinite(values).sum()]
        reached = np.cumsum(weights[order]) > (1 - share + _HAIR) * weights.sum()
        at = order[reached.argmax()] if share < 1 else order[0]
        return AreaVerdict(float(values[at]), enough, undecided, int(order[0]), values)

    def _measured(self, parts: Parts, boxes: NDArray[np.float64]) -> PartValues:
        """Measure the objects at the places of parts; `boxes` by heading, (headings, N, 7)."""
        free = ~np.isnan(boxes[:, :, 0])
        measured = self.measure(boxes[free])
        by_heading = np.full((*free.shape, measured.shape[1]), np.inf)
        by_heading[free] = measured
        values = by_heading.min(axis=0)
        unknown = np.full(values.shape, np.inf)
        return PartValues(parts, values, by_heading.argmin(axis=0), -unknown, unknown)

    def _interval(self, field: PartValues) -> NDArray[np.float64]:
        """Return the ends of the intervals of the shares that have enough, shape (2, sets).

        Bounds decide a part. Of others that were split, the places are a random sample: the
        interval has SIGMAS standard deviations of the sum of such parts at most; or all of them
        count for either end."""
        sure, fails = field.low >= self.need, field.high < self.need
        weights = np.where(sure | fails, 0.0, field.weights)
        sampled = field.parts.sampled[:, None] & (self.share < 1)
        off = np.where(sampled, 0.0, weights).sum(axis=0)
        middle = (field.weights * np.where(sampled, field.values >= self.need, sure)).sum(axis=0)
        spread = 0.5 * SIGMAS * np.sqrt(np.where(sampled, weights**2, 0.0).sum(axis=0))
        ends = np.stack([middle - spread, middle + off + spread])
        return np.asarray(ends / field.weights.sum(axis=0))

    def _open(self, field: PartValues) -> NDArray[np.bool_]:
        """Return which sets have no sure verdict yet, shape (sets,)."""
        low, high = self._interval(field)
        if self.share == 1.0:  # one place is enough
            passes = (field.low >= self.need).all(axis=0, where=np.isfinite(field.values))
            return np.asarray(~passes & (field.values >= self.need).all(axis=0))
        return np.asarray((low < self.share - _HAIR) & (high >= self.share - _HAIR))

    def _sides(self, field: PartValues, both: bool) -> NDArray[np.bool_]:
        """Return whether sets need lower bounds, and whether upper ones, shape (2, sets).

        Only one of them can decide, unless `both` sides are near the need."""
        has = (field.weights * (field.values >= self.need)).sum(axis=0)
        passing = has >= (self.share - _HAIR) * field.weights.sum(axis=0)
        return np.array([passing | both, ~passing | both]) & self._open(field)

    def _bound(
        self,
        field: PartValues,
        free: NDArray[np.bool_],
        half: NDArray[np.float64],
        finest: bool,
        sides: NDArray[np.bool_],
    ) -> None:
        """Fill bounds that `sides` need: lower ones of parts with enough, upper ones of others.

        `free`: whether the object fits at the place of a part, (headings, N); elsewhere in a part
        that is not one of the `finest` it may. `half`: half the edges of the parts."""
        has, fits = field.values >= self.need, np.isfinite(field.values)
        mixed = np.asarray(~free.all(axis=0) & (not finest))[:, None]
        for bounds, rows, sign in (
            (field.low, has & np.isinf(field.low) & sides[0], -1.0),
            (field.high, ~has & np.isinf(field.high) & ~mixed & sides[1], 1.0),
        ):
            chosen = np.asarray((rows & fits).any(axis=1))
            if chosen.any():
                boxes = resized_boxes(
                    self.layout.requirement, field.parts.points[chosen], sign * half
                )
                values = self._around(boxes.reshape(-1, 7), has.shape[1])
                values = values.reshape(*boxes.shape[:2], -1)
                counts = free[:, chosen, None] | (not finest)
                worst = np.where(counts, values, np.inf).min(axis=0)
                pick = np.minimum if sign < 0 else np.maximum
                bounds[chosen] = pick(worst, field.values[chosen])

    def _around(self, boxes: NDArray[np.float64], sets: int) -> NDArray[np.float64]:
        """Measure boxes; nothing for empty ones, infinite for those around a sensor."""
        values, filled = np.zeros((len(boxes), sets)), boxes[:, 3:5].min(axis=1) >= 0.0
        if filled.any():
            values[filled] = self.measure(boxes[filled])
        values[filled & are_around(boxes, self.origins)] = np.inf
        return values


def resized_boxes(
    requirement: Requirement, points: NDArray[np.float64], half: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return boxes around those at all places within +-`half` of points, metres, by heading.

    For negative `half` they are the boxes common to all of them; a side may be negative."""
    assert requirement.placed is not None
    boxes = []
    for angle in requirement.placed.angles.tolist():
        c, s = abs(math.cos(angle)), abs(math.sin(angle))
        boxes.append(requirement.placed.boxes(points, angle))
        boxes[-1][:, 3:5] += 2.0 * np.array([[c, s], [s, c]]) @ half
    return np.stack(boxes)


def are_around(boxes: NDArray[np.float64], origins: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether boxes (N, 7) may be around one of the sensors at `origins`, (sensors, 3)."""
    away = np.linalg.norm(boxes[:, None, :2] - origins[:, :2], axis=2)
    return np.asarray(away.min(axis=1, initial=np.inf) < 0.5 * np.hypot(boxes[:, 3], boxes[:, 4]))
