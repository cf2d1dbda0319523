"""Fit of a correction: a factor by class and a distance, from counts of real points.

A ray on an object of class c at range r returns with probability `factor_c exp(-r / distance)`,
times the share that the LiDAR's own shadow leaves. The fit minimises the mean of
`|log2((simulated + 1/2) / (real + 1/2))|` over boxes: errors of factors count alike for rich and
for poor objects, and single boxes do not decide it."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.rigs.correction import OTHER
from lidarplace.validation.comparison import BELOW_M
from lidarplace.validation.simulation import Returns

FEWEST_TRACKS = 40  # of fewer tracks one number is fitted, and the page says that they are too few

FEWEST_OF_CLASS = 10  # tracks of a class with a factor of its own
DISTANCES_M = (
    math.inf, 400.0, 250.0, 180.0, 140.0, 115.0, 100.0, 85.0, 75.0, 65.0, 55.0, 45.0, 35.0
)  # fmt: skip
"""Distances among which the fit chooses, metres."""
MOST_FACTOR = 2.0
RESAMPLES = 100  # of tracks, for the intervals


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


@dataclass(frozen=True)
class FitData:
    """Counts that a fit sees: n boxes nearer than `BELOW_M` whose real points are known."""

    track: NDArray[np.int64]  # number of the track of each
    name: NDArray[np.str_]  # class that decides the factor of each
    real: NDArray[np.float64]  # points of each
    simulated: NDArray[np.float64]  # returns for each of `DISTANCES_M`, shape (distances, n)

    @classmethod
    def of(cls, objects: pd.DataFrame, returns: Returns, shares: NDArray[np.float64]) -> "FitData":
        """Select objects, whose index is the row of the box, and what is simulated of them."""
        near = objects[(objects["distance"] < BELOW_M) & objects["real"].notna()]
        size = int(max(objects.index.max(), returns.box.max(initial=0))) + 1
        thinned = (returns.points * shares * np.exp(-returns.distance / d) for d in DISTANCES_M)
        simulated = [np.bincount(returns.box, points, size)[near.index] for points in thinned]
        track = np.asarray(near.groupby(["scene", "object_id"]).ngroup(), np.int64)
        names = near["class"].to_numpy(str)
        tracks = near.assign(track=track).groupby("class")["track"].nunique()
        few = [str(name) for name, number in tracks.items() if number < FEWEST_OF_CLASS]
        names = np.where(np.isin(names, np.array(few, np.str_)), OTHER, names)
        real = near["real"].to_numpy(np.float64)
        return cls(track, names.astype(np.str_), real, np.array(simulated))

    def fit(self, rows: NDArray[np.int64] | None = None) -> Fit:
        """Fit the correction of boxes `rows`, some perhaps repeatedly; of all for None.

        Raises ValueError: none has both real and simulated points."""
        if rows is None:
            rows = np.arange(len(self.real))
        real, names = self.real[rows], self.name[rows]
        if not ((real > 0) & (self.simulated[0][rows] > 0)).any():
            raise ValueError("too few objects with both real and simulated points for a fit")
        few = len(np.unique(self.track[rows])) < FEWEST_TRACKS
        classes, class_of = np.unique(names, return_inverse=True)
        best, least = Fit({}, None), math.inf
        for distance, all_simulated in zip(DISTANCES_M, self.simulated, strict=True):
            if few and distance < math.inf:
                break
            simulated = all_simulated[rows]
            factor = {OTHER: _factor(simulated, real)}
            if not few:
                factor |= {n: _factor(simulated[names == n], real[names == n]) for n in classes}
            fitted = Fit(factor, None if distance == math.inf else distance)
            expected = simulated * fitted.factors(classes)[class_of]
            loss = float(np.abs(np.log2((expected + 0.5) / (real + 0.5))).mean())
            if loss < least:
                best, least = fitted, loss
        return best

    def intervals(self, seed: int = 0) -> dict[str, tuple[float, float]]:
        """Compute 95 % intervals of the factors and of the distance, from resampled tracks.

        An infinite distance is infinite in them, too."""
        random = np.random.default_rng(seed)
        order = np.argsort(self.track, kind="stable")
        parts = np.split(order, np.cumsum(np.bincount(self.track))[:-1])
        resampled = []
        for _ in range(RESAMPLES):
            chosen = random.integers(0, len(parts), len(parts))
            fitted = self.fit(np.concatenate([parts[n] for n in chosen]))
            resampled.append(fitted.factor | {"distance": fitted.distance or math.inf})
        table = pd.DataFrame(resampled)
        ends = table.quantile([0.025, 0.975], interpolation="nearest")  # inf has no neighbours
        return {str(name): (low, high) for name, (low, high) in ends.items()}


def _factor(simulated: NDArray[np.float64], real: NDArray[np.float64]) -> float:
    """Return the median of real over simulated points; 1 where no object has both."""
    both = (simulated > 0) & (real > 0)
    return min(float(np.median(real[both] / simulated[both])), MOST_FACTOR) if both.any() else 1.0
