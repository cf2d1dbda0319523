"""A rig in several tests, such as towns, densities and vehicles: its mean over them, or its worst.

Each metric of each class is taken by itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.metrics import METRICS

Over = Literal["mean", "worst"]

_KEY = ["class", "metric", "iou"]


def metrics_over_tests(tables: Sequence[pd.DataFrame], over: Over) -> pd.DataFrame:
    """One table of metrics, see `training.kitti_ap.evaluate_boxes`, from that of each test.

    A value is NaN where a test had no object; ground truths are those of all tests.
    """
    first = tables[0]
    values = np.stack([table["value"].to_numpy(np.float64) for table in tables])
    truths = np.sum([table["ground_truths"] for table in tables], axis=0)
    return first.assign(value=_over(values, first["metric"], over), ground_truths=truths)


def left_out_over_tests(
    metrics: Sequence[pd.DataFrame],
    left_out: Sequence[pd.DataFrame],
    traffic: Sequence[int],
    over: Over,
) -> pd.DataFrame:
    """What `metrics_over_tests` is without each route, and without each individual.

    Args:
        metrics, left_out: of each test, see `training.kitti_ap.Evaluation`.
        traffic: number of each test's traffic; what is left out of one is left out of all tests
            on that traffic.
    """
    tables = []
    for number in dict.fromkeys(traffic):
        own = next(t for t, other in zip(left_out, traffic, strict=True) if other == number)
        values = np.stack(
            [
                without["value"].to_numpy(np.float64) if other == number else _of_each(own, whole)
                for whole, without, other in zip(metrics, left_out, traffic, strict=True)
            ]
        )
        names = f"traffic {number}: " + own["left_out"].astype(str)
        tables.append(own.assign(left_out=names, value=_over(values, own["metric"], over)))
    whole = pd.concat(tables)
    whole = whole[whole["unit"] != "half"]  # of one traffic they are no halves of all
    return whole.reset_index(drop=True)


def _of_each(rows: pd.DataFrame, metrics: pd.DataFrame) -> NDArray[np.float64]:
    """For each row the value of its class, metric and IoU in a table of metrics."""
    values = metrics.set_index(_KEY)["value"]
    return values.reindex(pd.MultiIndex.from_frame(rows[_KEY])).to_numpy(np.float64)


def _over(values: NDArray[np.float64], metric: pd.Series, over: Over) -> NDArray[np.float64]:
    """Of every column, shape (tests, rows) to (rows,)."""
    if over == "mean":
        return values.mean(axis=0)
    more = metric.map(lambda name: METRICS[name].direction == "maximize").to_numpy()
    return np.where(more, values.min(axis=0), values.max(axis=0))
