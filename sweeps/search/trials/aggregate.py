"""Measured objectives over classes, and over tests such as towns, densities and vehicles.

Each metric of each class is taken by itself."""

import math
from collections.abc import Iterable, Sequence
from statistics import fmean
from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.metrics import METRICS, RANKING
from sweeps.configuration.objective import ObjectiveSettings
from sweeps.results.trial_results import headline_value
from tracking.statistics.jackknife import NOTHING

Over = Literal["mean", "worst"]
_KEY = ["class", "metric", "iou"]


def metrics_over_tests(tables: Sequence[pd.DataFrame], over: Over) -> pd.DataFrame:
    """Merge the tables of metrics of several tests, see `training.kitti_ap.evaluate_boxes`.

    A value is NaN where a test had no object; ground truths are those of all tests."""
    first = tables[0]
    values = np.stack([table["value"].to_numpy(np.float64) for table in tables])
    truths = np.sum([table["ground_truths"] for table in tables], axis=0)
    return first.assign(value=_over(values, first["metric"], over), ground_truths=truths)


def left_out_over_tests(
    left_out: Sequence[pd.DataFrame], traffic: Sequence[int], over: Over
) -> pd.DataFrame:
    """Merge tables of a rig without each route, without each individual and with nothing left out.

    `left_out`: one of each test, see `training.kitti_ap.Evaluation`. `traffic`: number of the
    traffic of each test; what is left out of one test is left out of all tests on that traffic."""
    wholes = [table[table["unit"] == NOTHING].set_index(_KEY)["value"] for table in left_out]
    tables = []
    for number in dict.fromkeys(traffic):
        first_table = next(t for t, other in zip(left_out, traffic, strict=True) if other == number)
        keys = pd.MultiIndex.from_frame(first_table[_KEY])
        tests = zip(wholes, left_out, traffic, strict=True)
        columns = [
            without["value"] if other == number else whole.reindex(keys)
            for whole, without, other in tests
        ]
        values = np.stack([column.to_numpy(np.float64) for column in columns])
        names = f"traffic {number}: " + first_table["left_out"].astype(str)
        names = names.where(first_table["unit"] != NOTHING, "")
        over_tests = _over(values, first_table["metric"], over)
        tables.append(first_table.assign(left_out=names, value=over_tests))
    table = pd.concat(tables)
    table = table[table["unit"] != "half"]  # of one traffic they are no halves of all
    return table.drop_duplicates([*_KEY, "unit", "left_out"], ignore_index=True)


def _over(values: NDArray[np.float64], metric: pd.Series, over: Over) -> NDArray[np.float64]:
    """Merge the tests of every column, shape (tests, rows) to (rows,)."""
    if over == "mean":
        return np.asarray(values.mean(axis=0))
    more = metric.map(lambda name: METRICS[name].direction == "maximize").to_numpy()
    return np.asarray(np.where(more, values.min(axis=0), values.max(axis=0)))


def weighted_value(
    objective: ObjectiveSettings, classes: Sequence[str], metrics: pd.DataFrame
) -> float:
    """Return the weighted mean over classes, percent, of a metric and those of `also`."""
    values = []
    for part in objective.parts:
        weights = class_weights(part, classes)
        total = math.fsum(w * headline_value(metrics, part.by, c) for c, w in weights.items())
        values.append(total / math.fsum(weights.values()))
    return fmean(values)


def class_weights(objective: ObjectiveSettings, classes: Iterable[str]) -> dict[str, float]:
    """Return the weights by class; of all objects if the metric is of them and none is named."""
    assert objective.by in RANKING
    of_all = METRICS[objective.by].of_all and objective.weights is None
    return {"all": 1.0} if of_all else objective.weights_of(classes)
