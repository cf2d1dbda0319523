"""Correlation of surrogates with AP and recall over placements, also with each left out."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from tracking.findings.paired import Paired, group_columns, paired
from tracking.statistics.coefficients import (
    COEFFICIENTS,
    LARGEST_EXACT,
    adjust,
    distinct_tests,
    permutation_p,
    scores,
    smallest_p,
)
from tracking.statistics.confidence_interval import LEAST_PLACEMENTS, intervals
from tracking.statistics.reliability import reliability, without_seeds
from tracking.statistics.straight_line import left_out_means, left_out_predictions, rmse

FEW_PLACEMENTS = 6

_ESTIMATES, _ADJUSTED = (
    tuple(f"{coefficient}{suffix}" for coefficient in COEFFICIENTS for suffix in suffixes)
    for suffixes in (("", "_low", "_high", "_p"), ("_holm", "_fdr", "_tests"))
)


def correlate(
    results: pd.DataFrame, surrogates: pd.DataFrame, axes: Sequence[str] = (), seed: int = 0
) -> pd.DataFrame:
    """Correlate every surrogate with every metric over the placements of a sweep.

    A placement counts with its mean over seeds, see `without_seeds` for missing ones. No sign is
    assumed: tests are two-sided. Intervals are 95 % ones of the correlation with the metric as
    expected over seeds, so they allow for the seeds' noise. p-values: `permutation_p`. Surrogates
    that order placements alike, or reversed, are one test. Arguments and errors are those of
    `tracking.findings.paired.paired`; `seed` is of the permutations.

    One row per (class, detector, axes, metric, iou, difficulty, surrogate): `n` placements,
    the smallest number of `seeds`, `reliability` of the means over seeds, and for each of
    pearson, spearman and kendall the value, `_low`, `_high` and `_p`; `_holm`, adjusted
    family-wise, `_fdr`, by false discovery rate, and `_tests`, how many different tests both
    were adjusted for; `exact`, whether every p is from all permutations; `note`, why there is no
    number or what to keep in mind; `pairs_tested`, rows of this table with a coefficient."""
    rows: list[dict[str, object]] = []
    counted_as: dict[str, list[int]] = {coefficient: [] for coefficient in COEFFICIENTS}
    for group in paired(results, surrogates, axes):
        estimates, same = _estimates(group, seed)
        position = {name: len(rows) + i for i, name in enumerate(estimates)}
        for coefficient, names in same.items():
            counted_as[coefficient] += [position[names[name]] for name in estimates]
        rows += [{**group.group, "surrogate": name, **row} for name, row in estimates.items()]
    columns = [*group_columns(axes), "surrogate", "n", "seeds", "reliability", *_ESTIMATES]
    table = pd.DataFrame(rows, columns=[*columns, *_ADJUSTED, "exact", "note"])
    for coefficient, indices in counted_as.items():
        same_as = np.array(indices, dtype=np.intp)
        p = table[f"{coefficient}_p"].to_numpy(np.float64)
        table[f"{coefficient}_holm"] = adjust(p, same_as, "holm")
        table[f"{coefficient}_fdr"] = adjust(p, same_as, "fdr")
        table[f"{coefficient}_tests"] = len(np.unique(same_as[np.isfinite(p)]))
    table["pairs_tested"] = int(table["pearson"].notna().sum())
    return table


def _estimates(
    group: Paired, seed: int
) -> tuple[dict[str, dict[str, object]], dict[str, dict[str, str]]]:
    """Estimate each surrogate; by coefficient also whose test each one repeats."""
    estimates: dict[str, dict[str, object]] = {}
    same: dict[str, dict[str, str]] = {coefficient: {} for coefficient in COEFFICIENTS}
    # Surrogates known for the same placements are done in one go.
    for placements, names in group.by_placements():
        x = group.surrogates.loc[placements, names].to_numpy(np.float64).T
        block = _block(x, group.metric.loc[placements].to_numpy(np.float64), seed)
        for name, row in zip(names, block, strict=True):
            estimates[name] = row
            if row["note"] == "constant":
                row["note"] = f"{name} is the same for every placement"
        for coefficient in COEFFICIENTS:
            first = distinct_tests(x, coefficient) if len(placements) else np.arange(len(names))
            same[coefficient] |= {name: names[i] for name, i in zip(names, first, strict=True)}
    return {str(name): estimates[str(name)] for name in group.surrogates}, same


def _block(x: NDArray[np.float64], y: NDArray[np.float64], seed: int) -> list[dict[str, object]]:
    """Estimate each row of `x` (k, n) against the seed means of `y` (n, seeds)."""
    n = len(y)
    seeds = np.isfinite(y).sum(axis=1)
    start: dict[str, object] = {
        "n": n,
        "seeds": int(seeds.min()) if n else 0,
        "reliability": _reliability(y) if n else np.nan,
        **dict.fromkeys(_ESTIMATES, np.nan),
        "exact": n <= LARGEST_EXACT,
    }
    rows = [dict(start) for _ in x]
    if n < 3:
        note = "no value: the class has no ground truth" if n == 0 else "fewer than 3 placements"
        return [{**row, "note": note} for row in rows]
    mean = without_seeds(y).means
    for coefficient in COEFFICIENTS:
        values = scores(x, coefficient) @ scores(mean, coefficient)
        p = permutation_p(x, mean, coefficient, seed)
        bounds = intervals(x, y, coefficient)
        for i, row in enumerate(rows):
            row[coefficient] = values[i]
            row[f"{coefficient}_low"], row[f"{coefficient}_high"] = bounds[i]
            row[f"{coefficient}_p"] = p[i]
    notes = []
    if n < LEAST_PLACEMENTS:
        notes.append(f"{n} placements are too few for an interval")
    if n < FEW_PLACEMENTS:
        notes.append(f"few placements: the smallest possible two-sided p is {smallest_p(n):.2g}")
    if seeds.max() < 2:
        notes.append("one seed: the interval does not include seed noise")
    flat = np.isnan(scores(mean, "pearson")).any()
    for i, row in enumerate(rows):
        if flat:
            row["note"] = "the metric is the same for every placement"
        elif np.isnan(scores(x[i], "pearson")).any():
            row["note"] = "constant"
        else:
            row["note"] = "; ".join(notes)
    return rows


def _reliability(y: NDArray[np.float64]) -> float:
    fit, share = without_seeds(y), (1 / np.isfinite(y).sum(axis=1)).mean()
    return float(reliability(fit.means, fit.variance * share, fit.degrees)[0])


def leave_one_out(
    results: pd.DataFrame, surrogates: pd.DataFrame, axes: Sequence[str] = ()
) -> pd.DataFrame:
    """Compute Spearman's rho without each placement in turn, and the error of predicting it.

    The rows, arguments and errors of `correlate`: `n` placements; `spearman_min` and
    `spearman_max`, the range of rho without one placement; `rmse`, in the unit of the metric, of
    predicting each placement by the straight line of the surrogate through the others, and
    `rmse_of_mean`, by their mean. NaN with fewer than 4 placements or a constant; see `note`."""
    rows: list[dict[str, object]] = []
    for group in paired(results, surrogates, axes):
        estimates: dict[str, dict[str, object]] = {}
        for placements, names in group.by_placements():
            y = without_seeds(group.metric.loc[placements].to_numpy(np.float64)).means
            values = group.surrogates.loc[placements, names].to_numpy(np.float64).T
            estimates |= {name: _without_each(x, y) for name, x in zip(names, values, strict=True)}
        rows += [
            {**group.group, "surrogate": name, **estimates[str(name)]} for name in group.surrogates
        ]
    columns = [*group_columns(axes), "surrogate", "n", "spearman_min", "spearman_max"]
    return pd.DataFrame(rows, columns=[*columns, "rmse", "rmse_of_mean", "note"])


def _without_each(x: NDArray[np.float64], y: NDArray[np.float64]) -> dict[str, object]:
    n = len(y)
    if n < LEAST_PLACEMENTS:
        return {"n": n, "note": f"fewer than {LEAST_PLACEMENTS} placements"}
    for variable, values in (("the surrogate", x), ("the metric", y)):
        if np.isnan(scores(values, "pearson")).any():
            return {"n": n, "note": f"{variable} is the same for every placement"}
    others = np.arange(n - 1) + (np.arange(n - 1) >= np.arange(n)[:, None])
    rho = (scores(x[others], "spearman") * scores(y[others], "spearman")).sum(axis=1)
    rho = rho[np.isfinite(rho)]
    return {
        "n": n,
        "spearman_min": rho.min() if len(rho) else np.nan,
        "spearman_max": rho.max() if len(rho) else np.nan,
        "rmse": rmse(left_out_predictions(x, y), y),
        "rmse_of_mean": rmse(left_out_means(y), y),
        "note": "",
    }
