"""Do simulated clouds rank placements as clouds do that their LiDARs recorded?"""

import numpy as np
import pandas as pd

from tracking.findings.correlation import correlate
from tracking.findings.generalist import calibration
from tracking.kitti_iou import judged
from tracking.run_folders.sweep import RunFolder

CLOUDS = "scene.clouds"
"""The axis over recorded and simulated clouds of the same placements."""
KINDS = ("recorded", "simulated")


def side_by_side(run: RunFolder) -> pd.DataFrame:
    """AP or recall of detectors on recorded clouds and of those on simulated ones.

    Returns:
        One row per (class, detector, further axes, placement) with both: metric and iou, the
        headline's, and means over seeds in columns `recorded` and `simulated`, percent. Empty
        unless `CLOUDS` is an axis with both.
    """
    axes = [axis for axis in run.axes if axis != CLOUDS]
    keys = ["class", "detector", *axes, "metric", "iou", "placement"]
    found = _headline(run)
    if found.empty or set(found[CLOUDS]) < set(KINDS):
        return pd.DataFrame(columns=[*keys, *KINDS])
    means = found.groupby([*keys, CLOUDS], dropna=False, sort=False)["value"].mean()
    table = means.unstack(CLOUDS).dropna(subset=list(KINDS)).reset_index()
    return table[[*keys, *KINDS]].rename_axis(columns=None)


def rank_agreement(run: RunFolder) -> pd.DataFrame:
    """Correlation of simulated means with recorded ones over placements.

    Returns:
        Rows of `tracking.findings.correlation.correlate`, whose metric is that on recorded clouds,
        where a placement has both; and `bias`, `bias_low`, `bias_high` (`calibration`): simulated
        less recorded, points.
    """
    pairs = side_by_side(run)
    if pairs.empty:
        return pd.DataFrame()
    axes = [axis for axis in run.axes if axis != CLOUDS]
    results = _headline(run)
    keys = ["class", "detector", *axes]
    simulated = pairs[[*keys, "placement"]].assign(surrogate=KINDS[1], value=pairs[KINDS[1]])
    table = correlate(results[results[CLOUDS] == KINDS[0]], simulated, axes)
    table = table[table["n"] > 0]
    rows = []
    for key, own in pairs.groupby(keys, dropna=False, sort=False):
        found = calibration(*(own[kind].to_numpy(np.float64) for kind in KINDS[::-1]))
        rows.append(dict(zip(keys, key, strict=True)) | (found or {}))
    biases = pd.DataFrame(rows).reindex(columns=[*keys, "bias", "bias_low", "bias_high"])
    return table.merge(biases, on=keys, how="left")


def _headline(run: RunFolder) -> pd.DataFrame:
    """The results of every class by its headline metric; none without the axis."""
    if CLOUDS not in run.axes:
        return run.results.iloc[:0]
    names = (*run.classes, "all")
    return pd.concat([judged(run.results, run.results, name) for name in names])
