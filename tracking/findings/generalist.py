"""Does one detector for all rigs rank them as detectors do that were trained for each?"""

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
    """What the generalist's value of a metric is called among the surrogates."""
    return f"generalist's {'recall' if metric in _RECALL else metric_name(metric)}"


JUDGEMENTS = tuple(judgement_name(name) for name in _OF_A_CLASS)
"""What the generalist says of a placement, by name."""
CALIBRATION = ("bias", "bias_low", "bias_high", "slope", "slope_low", "slope_high")
"""Columns of `compare` by `calibration`."""


def judgements(run: RunFolder) -> pd.DataFrame:
    """The generalist's AP and recall as candidates next to the surrogates.

    Means over its seeds at the headline's IoU. Columns placement, class, detector, the further axes
    of the run (`evaluator` that of the placement's own detectors), surrogate (`JUDGEMENTS`) and
    value, percent. Empty without a generalist or with nothing else.
    """
    keys = ["placement", "detector", *run.axes]
    columns = [*keys, "class", "surrogate", "value"]
    if EVALUATOR not in run.axes:
        return pd.DataFrame(columns=columns)
    one = run.results[EVALUATOR] == _who(run.results)
    own = run.results.loc[~run.results[EVALUATOR].isin(ONE_FOR_ALL), [EVALUATOR]].drop_duplicates()
    parts = []
    for name in (*run.classes, "all"):
        for metric in _RECALL[1:] if name == "all" else _OF_A_CLASS:
            rows = at_headline_iou(run.results[one], run.results, name, metric)
            means = rows.groupby(keys, dropna=False, sort=False)["value"].mean().dropna()
            part = means.reset_index().drop(columns=EVALUATOR).merge(own, how="cross")
            parts.append(part.assign(**{"class": name, "surrogate": judgement_name(metric)}))
    return pd.concat(parts, ignore_index=True)[columns]


def _who(table: pd.DataFrame) -> str:
    """The evaluator of a table that is one detector for all: the first where there are two."""
    return next((name for name in ONE_FOR_ALL if (table[EVALUATOR] == name).any()), ONE_FOR_ALL[0])


def with_judgements(run: RunFolder) -> pd.DataFrame:
    """The surrogates of a run and, where it has a generalist among others, its `judgements`."""
    added = judgements(run)
    return run.surrogates if added.empty else pd.concat([run.surrogates, added], ignore_index=True)


def calibration(said: NDArray[np.float64], own: NDArray[np.float64]) -> dict[str, float] | None:
    """The generalist's values against those of the placements' own detectors, means over seeds.

    By `CALIBRATION`: bias, the mean of the generalist's less their own, and slope of the
    least-squares line of their own over the generalist's, whose noise lowers it; with Student's
    95 % intervals over placements. None for fewer than 3 or without any spread.
    """
    n = len(said)
    if n < 3 or np.ptp(said) == 0:
        return None
    difference, line = said - own, stats.linregress(said, own)
    half = stats.t.ppf(0.975, n - 1) * difference.std(ddof=1) / np.sqrt(n)
    wide = stats.t.ppf(0.975, n - 2) * line.stderr
    pairs = ((difference.mean(), half), (line.slope, wide))
    found = [bound for value, to in pairs for bound in (value, value - to, value + to)]
    return dict(zip(CALIBRATION, map(float, found), strict=True))


def side_by_side(means: pd.DataFrame, group: Mapping[Hashable, Any]) -> pd.DataFrame:
    """Placements that both judged, in the order of their own detectors' values.

    `means` are `seed_means` of the run, `group` has a value of each of `group_columns`. Index
    placement: said and own, percent.
    """
    place = {key: value for key, value in group.items() if key != EVALUATOR}
    known = at(means[means["seeds"] > 0], place)
    values = known.pivot(index="placement", columns=EVALUATOR, values="mean")
    both = {"said": values[_who(known)], "own": values[group[EVALUATOR]]}
    return pd.DataFrame(both).dropna().sort_values("own", ascending=False)


def compare(run: RunFolder, means: pd.DataFrame, correlations: pd.DataFrame) -> pd.DataFrame:
    """How well the generalist predicts AP and recall of placements with a detector of their own.

    The rows of `correlations` (`tracking.findings.ceiling.beside` of the run and its `judgements`)
    of the same metric at the headline's IoU, with `CALIBRATION`, NaN for fewer than 3 placements.
    """
    same = correlations["surrogate"] == correlations["metric"].map(judgement_name)
    known = correlations[same & (correlations["n"] > 0)]
    at = [at_headline_ious(known, run.results, name) for name in (*run.classes, "all")]
    rows = pd.concat(at).sort_index().reset_index(drop=True)
    keys = group_columns(run.axes)
    pairs = [side_by_side(means, row) for row in rows[keys].to_dict("records")]
    found = [calibration(pair["said"].to_numpy(), pair["own"].to_numpy()) for pair in pairs]
    table = pd.DataFrame([one or {} for one in found], columns=CALIBRATION)
    return rows.join(table.astype("float64"))


def seconds_a_placement(trials: pd.DataFrame) -> pd.DataFrame:
    """What a judgement costs: detector, evaluator, trials that finished, and their median seconds.
    Of a generalist that is its evaluation, of others training and evaluation; without clouds."""
    finished = trials[trials["status"] == "finished"]
    own = finished.groupby(["detector", EVALUATOR], sort=False)["seconds"]
    return own.agg(trials="size", seconds="median").reset_index()
