"""Real and simulated points of the same objects: how far apart they are."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

BELOW_M = 75.0
"""Objects farther away are left out: they have few points, real ones or simulated ones."""

BANDS_M = (0.0, 10.0, 20.0, 30.0, 40.0, 50.0, BELOW_M)  # edges of the bands of distance in tables

LEAST = (5, 20)  # points of an object that a detector can find: shares are reported for both

_FEWEST = 20  # objects of a row of a table


def log_ratio(simulated: NDArray[np.float64], real: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return log2 of simulated over real points, of objects with 5 simulated ones, shape (those,).

    It is infinite without real points. With fewer simulated ones its median is not 0 even where the
    expected points are right, as points are whole numbers."""
    enough = simulated >= LEAST[0]
    with np.errstate(divide="ignore"):
        return np.asarray(np.log2(simulated[enough] / real[enough]))


def scores(
    simulated: NDArray[np.float64],
    real: NDArray[np.float64],
    chance: dict[int, NDArray[np.float64]],
) -> dict[str, float]:
    """Score simulated points of objects against real ones.

    `chance` is the probability that a simulated object has at least so many points, by `LEAST`.

    Returns objects; ratio of sums; bias, the median of log2 of the ratios; spread, the median of
    its absolute value; within_2, the share within a factor 2; rho, Spearman's, over objects; and
    for each n of `LEAST` the shares real_n and simulated_n of objects with n points."""
    ratio = log_ratio(simulated, real)
    values = {
        "objects": float(len(real)),
        "ratio": float(simulated.sum() / real.sum()) if real.sum() else np.nan,
        "bias": _of_some(np.median, ratio),
        "spread": _of_some(np.median, np.abs(ratio)),
        "within_2": _of_some(np.mean, np.abs(ratio) <= 1),
        "rho": rank_correlation(simulated, real),
    }
    for least in LEAST:
        values[f"real_{least}"] = _of_some(np.mean, real >= least)
        values[f"simulated_{least}"] = _of_some(np.mean, chance[least])
    return values


def _of_some(statistic: Callable[[Any], Any], values: NDArray[Any]) -> float:
    return float(statistic(values)) if len(values) else np.nan


def rank_correlation(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Return Spearman's rho; NaN of fewer than 3, or of equal numbers."""
    if len(a) < 3:
        return np.nan
    return float(pd.Series(a).rank().corr(pd.Series(b).rank()))


def chances(
    rays: NDArray[np.float64], expected: NDArray[np.float64]
) -> dict[int, NDArray[np.float64]]:
    """Compute the probability of at least so many points of every object, by `LEAST`; (objects,).

    Each of its `rays` returns by itself, `expected` many in all."""
    from scipy.stats import binom

    share = np.divide(expected, rays, out=np.zeros_like(expected), where=rays > 0)
    return {n: np.asarray(binom.sf(n - 1, np.round(rays), np.minimum(share, 1.0))) for n in LEAST}


def comparison(objects: pd.DataFrame, models: Sequence[str]) -> pd.DataFrame:
    """Score models by distance, class and route; rows of few objects are left out.

    Objects have columns class, route, distance, world, real, rays/MODEL (of them, before anything
    gets lost) and points/MODEL. Returns columns model, by (all, distance, class or route), group,
    those of `scores`, and world, the share of objects in scenes with a static world."""
    near = objects[(objects["distance"] < BELOW_M) & objects["real"].notna()]
    band = pd.cut(near["distance"], list(BANDS_M), right=False)
    names = band.map(lambda interval: f"{interval.left:g} to {interval.right:g} m").astype(object)
    groups: dict[str, Iterable[tuple[object, pd.DataFrame]]] = {
        "all": [("all", near)],
        "distance": near.groupby(names, sort=False),
        "class": near.groupby("class"),
        "route": near.groupby("route"),
    }
    rows = []
    for model in models:
        for by, parts in groups.items():
            large = [(str(n), part) for n, part in parts if len(part) >= _FEWEST or by == "all"]
            if by == "distance":
                large.sort(key=lambda item: float(item[0].split()[0]))
            for name, part in large:
                points = part[f"points/{model}"].to_numpy(np.float64)
                chance = chances(part[f"rays/{model}"].to_numpy(np.float64), points)
                values = scores(points, part["real"].to_numpy(np.float64), chance)
                world = float(part["world"].mean())
                rows.append({"model": model, "by": by, "group": name, **values, "world": world})
    return pd.DataFrame(rows)


def floor(objects: pd.DataFrame) -> dict[str, float]:
    """Score the real points of an object against those in the frame before.

    No simulation of single frames can be nearer than the world is to itself."""
    near = objects[(objects["distance"] < BELOW_M) & objects["real"].notna()]
    near = near.sort_values(["scene", "object_id", "frame"])
    before = near.groupby(["scene", "object_id"])[["real", "frame"]].shift()
    follows = near["frame"] - before["frame"] == 1
    real, earlier = (table.loc[follows, "real"].to_numpy(np.float64) for table in (near, before))
    return scores(earlier, real, {n: (earlier >= n).astype(np.float64) for n in LEAST})
