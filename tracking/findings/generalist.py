"""Comparison of one detector for all rigs with detectors that were trained for each."""

from collections.abc import Hashable, Mapping
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from lidarplace.base.metrics import HEADLINE_METRIC, headline_metric
from tracking.findings.groups import EVALUATOR, ONE_FOR_ALL, at
from tracking.findings.paired import group_columns
from tracking.kitti_iou import at_headline_iou, at_headline_ious
from tracking.labels import metric_name
from tracking.run_folders.sweep import RunFolder

_RECALL = ("class_recall_3D", headline_metric("all"))  # of a class, and of all objects
_OF_A_CLASS = (HEADLINE_METRIC, _RECALL[0])


def judgement_name(metric: str) -> str:
    """Name the generalist's value of a metric as a surrogate."""
    return f"generalist's {'recall' if metric in _RECALL else metric_name(metric)}"


JUDGEMENTS = tuple(judgement_name(name) for name in _OF_A_CLASS)
"""Names of the generalist's values of a placement."""
CALIBRATION = ("bias", "bias_low", "bias_high", "slope", "slope_low", "slope_high")
"""Columns of `compare` by `calibration`."""


def judgements(run: RunFolder) -> pd.DataFrame:
    """Make candidates of the generalist's AP and recall, next to the surrogates.

    Means over its seeds at the headline's IoU. Columns placement, class, detector, the further axes
    of the run (`evaluator` that of the placement's own detectors), surrogate (`JUDGEMENTS`) and
    value, percent. Empty without a generalist or with nothing else."""
    keys = ["placement", "detector", *run.axes]
    columns = [*keys, "class", "surrogate", "value"]
    if EVALUATOR not in run.axes:
        return pd.DataFrame(columns=columns)
    by_generalist = run.results[EVALUATOR] == _who(run.results)
    others = run.results.loc[~run.results[EVALUATOR].isin(ONE_FOR_ALL), [EVALUATOR]]
    others = others.drop_duplicates()
    parts = []
    for name in (*run.classes, "all"):
        for metric in _RECALL[1:] if name == "all" else _OF_A_CLASS:
            rows = at_headline_iou(run.results[by_generalist], run.results, name, metric)
            means = rows.groupby(keys, dropna=False, sort=False)["value"].mean().dropna()
            part = means.reset_index().drop(columns=EVALUATOR).merge(others, how="cross")
            parts.append(part.assign(**{"class": name, "surrogate": judgement_name(metric)}))
    return pd.concat(parts, ignore_index=True)[columns]


def _who(table: pd.DataFrame) -> str:
    """Name the evaluator of a table that is one detector for all: the first where there are two."""
    return next((name for name in ONE_FOR_ALL if (table[EVALUATOR] == name).any()), ONE_FOR_ALL[0])


def with_judgements(run: RunFolder) -> pd.DataFrame:
    """Add the `judgements` of a run's generalist to its surrogates, if it has other detectors."""
    added = judgements(run)
    return run.surrogates if added.empty else pd.concat([run.surrogates, added], ignore_index=True)


def calibration(
    generalist: NDArray[np.float64], specialist: NDArray[np.float64]
) -> dict[str, float] | None:
    """Compare the generalist's means over seeds with those of the placements' own detectors.

    By `CALIBRATION`: bias, the mean of the generalist's less their own, and slope of the
    least-squares line of their own over the generalist's, whose noise lowers it; with Student's
    95 % intervals over placements. None for fewer than 3 or without any spread."""
    n = len(generalist)
    if n < 3 or np.ptp(generalist) == 0:
        return None
    difference, line = generalist - specialist, stats.linregress(generalist, specialist)
    half = stats.t.ppf(0.975, n - 1) * difference.std(ddof=1) / np.sqrt(n)
    wide = stats.t.ppf(0.975, n - 2) * line.stderr
    pairs = ((difference.mean(), half), (line.slope, wide))
    bounds = [bound for value, to in pairs for bound in (value, value - to, value + to)]
    return dict(zip(CALIBRATION, map(float, bounds), strict=True))


def side_by_side(means: pd.DataFrame, group: Mapping[Hashable, Any]) -> pd.DataFrame:
    """Pair the values of placements that both judged, in the order of their own detectors' values.

    `means` are `seed_means` of the run, `group` has a value of each of `group_columns`. Index
    placement: generalist and specialist, percent."""
    place = {key: value for key, value in group.items() if key != EVALUATOR}
    tested = at(means[means["seeds"] > 0], place)
    values = tested.pivot(index="placement", columns=EVALUATOR, values="mean")
    both = {"generalist": values[_who(tested)], "specialist": values[group[EVALUATOR]]}
    return pd.DataFrame(both).dropna().sort_values("specialist", ascending=False)


def compare(run: RunFolder, means: pd.DataFrame, correlations: pd.DataFrame) -> pd.DataFrame:
    """Rate how well the generalist predicts AP and recall of placements with own detectors.

    The rows of `correlations` (`tracking.findings.ceiling.with_ceilings` of the run and its
    `judgements`) of the same metric at the headline's IoU, with `CALIBRATION`, NaN for fewer than 3
    placements."""
    same = correlations["surrogate"] == correlations["metric"].map(judgement_name)
    with_values = correlations[same & (correlations["n"] > 0)]
    at = [at_headline_ious(with_values, run.results, name) for name in (*run.classes, "all")]
    rows = pd.concat(at).sort_index().reset_index(drop=True)
    keys = group_columns(run.axes)
    pairs = (side_by_side(means, row) for row in rows[keys].to_dict("records"))
    fits = [calibration(*pair[["generalist", "specialist"]].to_numpy().T) for pair in pairs]
    table = pd.DataFrame([one or {} for one in fits], columns=CALIBRATION)
    return rows.join(table.astype("float64"))


def seconds_a_placement(trials: pd.DataFrame) -> pd.DataFrame:
    """Compute the cost of an evaluation: detector, evaluator, finished trials, median seconds.

    Of a generalist that is its evaluation, of others training and evaluation, without clouds."""
    finished = trials[trials["status"] == "finished"]
    seconds = finished.groupby(["detector", EVALUATOR], sort=False)["seconds"]
    return seconds.agg(trials="size", seconds="median").reset_index()
