"""Verdicts on an object all over an area, which do not depend on the phase of a grid.

Every place counts as the nearest one that is tested. Where a verdict is open, places half a step
away from those near the limit are tested, too, down to `FINEST_M`; a verdict that is still open
says so."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from lidarplace.requirements.layout import RequirementLayout
from lidarplace.requirements.requirement import Requirement

_HAIR = 1e-9  # share of the area that rounding may move
_MOST_VALUES = 2**24  # of places by set, those that are not tested included

Measure = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Values of boxes, rows of `lidarplace.logs.boxes.GEOMETRY`, shape (B, sets)."""


class AreaVerdict(NamedTuple):
    """Verdict on an area by one set of sensors.

    Attributes:
        value: value that the share that counts has at least; below the need if the verdict is open.
        enough: share of the area that has enough.
        undecided: width of the interval of `enough` if the limit is in it; with a limit of 1 the
            share by which the least value may be lower; 0: the verdict is sure.
        refined: whether it takes more than the positions of the layout.
        worst: x and y, metres, heading, radians, and value where it is least."""

    value: float
    enough: float
    undecided: float
    refined: bool
    worst: tuple[float, float, float, float]


@dataclass(frozen=True)
class _Limit:
    """Limit of a requirement at places `step` metres apart, where a share is `off` at most."""

    requirement: Requirement
    step: float
    off: float

    @property
    def spare(self) -> float:
        """Multiple of the need with which places next to one have enough, too.

        Numbers of cells vary more than those of points."""
        assert self.requirement.placed is not None
        of_cells = self.requirement.measure in ("cells", "probability")
        return 1.0 + 2.0 * self.step / min(self.requirement.placed.size[:2]) + 0.25 * of_cells

    def near(self, values: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which places are near the limit, shape (nx, ny, sets).

        If all places count, those with little to spare; else those where some around have enough
        and some too little. Where no object fits (inf), some may around. NaN: not tested."""
        need, fits, around = self.requirement.least, np.isfinite(values), (3, 3, 1)
        if self.requirement.share == 1.0:
            near = fits & (values < self.requirement.multiple(need, self.spare))
        else:
            enough, short = fits & (values >= need), fits & (values < need)
            near = fits & maximum_filter(enough, around) & maximum_filter(short, around)
        return np.asarray(near | (np.isposinf(values) & maximum_filter(near, around)))

    def verdict(
        self,
        values: NDArray[np.float64],
        area: NDArray[np.float64],
        near: bool,
        worst: tuple[float, float, float, float],
    ) -> AreaVerdict:
        """Return the verdict on values of parts of an area, some of them `near` the limit."""
        wanted, undecided, counted = self.requirement, 0.0, self.requirement.share
        enough = float(area[values >= wanted.least].sum() / area.sum())
        if counted == 1.0:
            value = worst[-1]
            if near and value >= wanted.least:
                value, undecided = wanted.multiple(value, 1 / self.spare), 1.0 - 1 / self.spare
            return AreaVerdict(value, enough, undecided, False, worst)
        high = min(counted + self.off, 1.0)
        if max(counted - self.off, _HAIR) <= enough < high - _HAIR:
            counted, undecided = high, 2.0 * self.off
        order = values.argsort(kind="stable")
        reached = area[order].cumsum() > (1.0 - counted + _HAIR) * area.sum()
        value = float(values[order[reached.argmax()]])
        return AreaVerdict(value, enough, undecided, False, worst)


def verdicts(
    layout: RequirementLayout, pose: str, measure: Measure
) -> tuple[list[AreaVerdict], NDArray[np.float64]]:
    """Return the verdict of each set of sensors, and values at the layout's positions, (P, sets).

    The object fits somewhere around the vehicle in the pose."""
    wanted, held = layout.requirement, layout.positions.held
    first, headings = _worst(layout, layout.boxes_in(pose), measure)
    sure, numbers = dict[int, AreaVerdict](), range(first.shape[1])
    values, turned = (np.full((*held.shape, len(numbers)), np.nan) for _ in range(2))
    values[maximum_filter(held, 3)] = np.inf
    values[held], turned[held] = first, headings
    for level in range(layout.levels + 1):
        fits, (x, y) = np.isfinite(values[:, :, 0]), layout.lines(level)
        i, j = fits.nonzero()
        area = layout.areas(fits, pose)[fits] if level else layout.areas_in(pose)[fits[held]]
        limit = _Limit(wanted, wanted.step / 2**level, layout.precision(pose) / 2**level)
        near = limit.near(values)
        last = level == layout.levels or 4 * values.size > _MOST_VALUES
        for number in set(numbers) - set(sure):
            is_near, column = bool(near[..., number].any()), values[fits, number]
            at = int(column.argmin())
            heading, least = float(turned[i[at], j[at], number]), float(column[at])
            worst = float(x[i[at]]), float(y[j[at]]), heading, least
            verdict = limit.verdict(column, area, is_near, worst)
            if last or not is_near or not verdict.undecided:
                sure[number] = verdict._replace(refined=level > 0)
        if len(sure) == len(numbers):
            break
        split = np.asarray(near[..., [number not in sure for number in numbers]].any(axis=2))
        values, turned, new = _halved(values), _halved(turned), _halved(split) == 1
        new = maximum_filter(new, 3) & np.isnan(values[:, :, 0])
        points = np.stack(np.meshgrid(*layout.lines(level + 1), indexing="ij"), axis=-1)[new]
        values[new], turned[new] = _worst(layout, layout.boxes_at(points, pose), measure)
    return [sure[number] for number in numbers], first


def _worst(
    layout: RequirementLayout, boxes: NDArray[np.float64], measure: Measure
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the least values of boxes (headings, N, 7), and those headings, shape (N, sets).

    Values are infinite where no box fits."""
    assert layout.requirement.placed is not None
    free = ~np.isnan(boxes[:, :, 0])
    measured = measure(boxes[free])
    by_heading = np.full((*free.shape, measured.shape[1]), np.inf)
    by_heading[free] = measured
    headings = layout.requirement.placed.angles[by_heading.argmin(axis=0)]
    return by_heading.min(axis=0), headings


def _halved(grid: NDArray[Any]) -> NDArray[np.float64]:
    """Return a grid with places half a step away, NaN there."""
    finer = np.full((2 * grid.shape[0] - 1, 2 * grid.shape[1] - 1, *grid.shape[2:]), np.nan)
    finer[::2, ::2] = grid
    return finer
