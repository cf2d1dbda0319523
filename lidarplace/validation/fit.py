"""Fit of a correction: a factor by class and a distance, from counts of real points.

A ray on an object of class c at range r returns with probability `factor_c exp(-r / distance)`,
times the share that the LiDAR's own shadow leaves. The fit maximises a weighted Poisson likelihood
of the points of every box. Boxes without points count; those without rays enter its equations, as
real rays are not the simulated ones. It needs only a right mean, whatever the rays of an object
have in common (Santos Silva and Tenreyro, The Log of Gravity, 2006)."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.rigs.correction import OTHER
from lidarplace.validation.comparison import BELOW_M
from lidarplace.validation.simulation import Returns

FEWEST_TRACKS = 40  # of fewer tracks one number is fitted, and the page says that they are too few

FEWEST_OF_CLASS = 10  # tracks of a class with a factor of its own
MOST_FACTOR = 2.0
MOST_RAYS = 100.0
"""Limit of the weight of a box: n rays count as n / (1 + n / this), as they share its errors."""

_MOST_LOSS = 0.2  # inverse of the shortest distance, 1/m
_FLAT = 1e-9  # relative slope of a likelihood that does not depend on the distance


@dataclass(frozen=True)
class Fit:
    """Fitted loss of returns: a factor by class, OTHER for the rest, and a distance.

    The distance is in metres, None where nothing is lost with it."""

    factor: dict[str, float]
    distance: float | None

    def factors(self, classes: NDArray[np.str_]) -> NDArray[np.float64]:
        """Return the factors of objects of these classes."""
        return np.array([self.factor.get(n, self.factor[OTHER]) for n in classes], np.float64)

    def points(
        self, returns: Returns, classes: NDArray[np.str_], shares: NDArray[np.float64] | float = 1.0
    ) -> NDArray[np.float64]:
        """Compute expected returns of every row of `returns`, shape (N,).

        `classes` are of the log's boxes, `shares` what shadows leave of every row."""
        share = self.factors(classes)[returns.box]
        share = share * np.exp(-returns.distance / (self.distance or math.inf)) * shares
        return np.asarray(returns.points * np.minimum(share, 1.0))


LOSSLESS = Fit({OTHER: 1.0}, None)


class Thinning(NamedTuple):
    """Fitted loss of returns, and the shares that the LiDARs' own shadows leave."""

    fit: Fit
    mask: NDArray[np.float64]  # shape (LiDARs, SECTORS)

    def points(self, returns: Returns, classes: NDArray[np.str_]) -> NDArray[np.float64]:
        """Compute expected returns; see `Fit.points`."""
        return self.fit.points(returns, classes, returns.shares(self.mask))


class _Estimate(NamedTuple):
    """Most likely factors at an inverse distance, and what they predict for each box."""

    factor: NDArray[np.float64]  # shape (classes,)
    expected: NDArray[np.float64]  # points, shape (n,)
    away: NDArray[np.float64]  # mean range of them, metres, shape (n,)
    slope: float  # of the likelihood by the inverse distance


@dataclass(frozen=True)
class FitData:
    """Counts that a fit sees: n boxes nearer than `BELOW_M` whose real points are known."""

    track: NDArray[np.int64]  # number of the track of each, from 0 without gaps
    name: NDArray[np.str_]  # class that decides the factor of each
    real: NDArray[np.float64]  # points of each
    away: NDArray[np.float64]  # distance of each, metres
    box: NDArray[np.int64]  # number of the box for each row of rays, shape (rows,)
    rays: NDArray[np.float64]  # simulated returns of each row, after shadows
    distance: NDArray[np.float64]  # range of each row, metres

    @classmethod
    def of(cls, objects: pd.DataFrame, returns: Returns, shares: NDArray[np.float64]) -> "FitData":
        """Select objects, whose index is the row of the box, and what is simulated of them.

        Raises ValueError: none has both real and simulated points."""
        rays = returns.points * shares
        near = objects[(objects["distance"] < BELOW_M) & objects["real"].notna()]
        met = near.index.isin(returns.box[rays > 0])
        if not near["real"][met].any():
            raise ValueError("too few objects with both real and simulated points for a fit")
        track, name = near.groupby(["scene", "object_id"]).ngroup(), near["class"].astype(str)
        tracks = track[met].groupby(name[met]).nunique()
        name = name.where(name.map(tracks) >= FEWEST_OF_CLASS, OTHER)
        if track[met].nunique() < FEWEST_TRACKS:
            name[:] = OTHER
        elif track[met & (name == OTHER)].nunique() < FEWEST_OF_CLASS:
            near = near[name != OTHER]
        number = np.full(max(near.index.max(), returns.box.max()) + 1, -1, np.int64)
        number[near.index] = np.arange(len(near))
        rows = number[returns.box] >= 0
        _, numbers = np.unique(track[near.index], return_inverse=True)
        return cls(
            np.asarray(numbers, np.int64),
            name[near.index].to_numpy(np.str_),
            near["real"].to_numpy(np.float64),
            near["distance"].to_numpy(np.float64),
            np.asarray(number[returns.box[rows]]),
            rays[rows],
            returns.distance[rows],
        )

    def fit(self) -> Fit:
        """Fit the correction; without boxes of OTHER that factor is of all boxes together."""
        (names, class_of), loss = self._classes, self._loss(0.0)
        factor = {OTHER: float(self._at(loss, np.zeros_like(class_of)).factor[0])}
        factor |= zip(names.tolist(), self._at(loss, class_of).factor.tolist(), strict=True)
        return Fit(factor, 1.0 / loss if loss else None)

    def intervals(self) -> dict[str, tuple[float, float]]:
        """Compute 95 % intervals of the factors of classes, and of the distance in metres.

        They hold the fit, which has no distance below 0. That of a class without points is by the
        share of tracks with points. An infinite distance is infinite in them, too; of one track
        there is none."""
        if not self.track.any():
            return {}
        (names, class_of), fitted = self._classes, self.fit()
        estimate = self._at(loss := self._loss(-_MOST_LOSS), class_of)
        seen = np.flatnonzero(estimate.factor)
        half = self._half_widths(estimate, class_of, seen)
        ends, most = {}, math.log(MOST_FACTOR)
        for name, log, width in zip(names[seen], np.log(estimate.factor[seen]), half, strict=False):
            low, high = np.exp(np.minimum([log - width, log + width], most)).tolist()
            ends[str(name)] = min(low, fitted.factor[name]), max(high, fitted.factor[name])
        for number in np.flatnonzero(estimate.factor == 0):
            tracks = len(np.unique(self.track[class_of == number]))
            ends[str(names[number])] = 0.0, 1.0 - 0.05 ** (1.0 / tracks)
        if self._has_distance:
            low = max(loss - float(half[-1]), 0.0)
            high = max(loss + float(half[-1]), 1.0 / (fitted.distance or math.inf))
            ends["distance"] = 1.0 / high if high else math.inf, 1.0 / low if low else math.inf
        return ends

    def _half_widths(
        self, estimate: _Estimate, class_of: NDArray[np.int64], seen: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Compute half of the intervals of the logarithms of factors `seen`, and of the loss.

        A jackknife leaves out each track by a Newton step; Student's t has the degrees of freedom
        of as many tracks that weigh alike (Carter, Schnepel and Steigerwald, 2017)."""
        from scipy.stats import t

        columns = (class_of[:, None] == seen).astype(np.float64)
        if self._has_distance:
            columns = np.column_stack([columns, -estimate.away])
        weighted = columns * self._weight[:, None]
        score = self._of_tracks(weighted * (self.real - estimate.expected)[:, None])
        weighted *= estimate.expected[:, None]
        information = self._of_tracks(weighted[:, :, None] * columns[:, None])
        others = information.sum(axis=0) - information
        change = np.linalg.solve(others, score[:, :, None])[:, :, 0]
        spread = ((change - change.mean(axis=0)) ** 2).sum(axis=0) * (1.0 - 1.0 / len(change))
        diagonal = np.diagonal(information, axis1=1, axis2=2)
        alike = diagonal.sum(axis=0) ** 2 / (diagonal**2).sum(axis=0)
        return np.asarray(np.sqrt(spread) * t.isf(0.025, np.maximum(alike - 1.0, 0.5)))

    def _of_tracks(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Sum the values of boxes, shape (n, ...), by track."""
        order = np.argsort(self.track, kind="stable")
        _, first = np.unique(self.track[order], return_index=True)
        return np.asarray(np.add.reduceat(values[order], first))

    @cached_property
    def _classes(self) -> tuple[NDArray[np.str_], NDArray[np.int64]]:
        return np.unique(self.name, return_inverse=True)

    @cached_property
    def _weight(self) -> NDArray[np.float64]:
        return 1.0 / (1.0 + np.bincount(self.box, self.rays, len(self.real)) / MOST_RAYS)

    @cached_property
    def _has_distance(self) -> bool:
        enough = len(np.unique(self.track)) >= FEWEST_TRACKS
        return enough and self._at(-_MOST_LOSS, self._classes[1]).slope > _FLAT

    def _loss(self, least: float) -> float:
        """Find the most likely inverse distance from `least` on, 1/m."""
        from scipy.optimize import brentq

        def slope(loss: float) -> float:
            return self._at(loss, self._classes[1]).slope

        if not self._has_distance:
            return 0.0
        if slope(least) <= _FLAT:
            return least
        return float(brentq(slope, least, _MOST_LOSS)) if slope(_MOST_LOSS) < 0 else _MOST_LOSS

    def _at(self, loss: float, class_of: NDArray[np.int64]) -> _Estimate:
        rays, size = self.rays * np.exp(-loss * self.distance), len(self.real)
        returns, away = np.bincount(self.box, rays, size), self.away.copy()
        np.divide(
            np.bincount(self.box, rays * self.distance, size), returns, away, where=returns > 0
        )
        points = np.bincount(class_of, self._weight * self.real)
        most_likely = points / np.bincount(class_of, self._weight * returns)
        factor = np.minimum(most_likely, MOST_FACTOR)
        expected = np.asarray(factor[class_of] * returns, np.float64)
        slope = self._weight * away @ (expected - self.real) / (self._weight * away @ self.real)
        return _Estimate(factor, expected, away, float(slope))
