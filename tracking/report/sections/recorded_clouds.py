"""Comparison of simulated clouds with those that the same LiDARs recorded."""

import numpy as np
import pandas as pd

from tracking.findings.correlation import correlate
from tracking.findings.generalist import calibration
from tracking.kitti_iou import at_headline_iou
from tracking.labels import setting_label
from tracking.pages import section
from tracking.report.analysis import Analysis
from tracking.run_folders.sweep import RunFolder

_NOTE = (
    "Detectors were trained and evaluated on the clouds that the LiDARs of each placement "
    "recorded, and on simulated clouds of the same LiDARs. ρ and τ: whether both rank the "
    "placements alike. Their 95 % intervals allow for the seeds of the detectors on recorded "
    "clouds. Bias: simulated less recorded, mean over placements, with its 95 % interval."
)


def recorded_clouds_section(analysis: Analysis) -> section.Section | None:
    """Compare both kinds of clouds; None unless placements have results on both."""
    run = analysis.run
    pairs = side_by_side(run)
    if pairs.empty:
        return None
    axes = [axis for axis in run.axes if axis != CLOUDS]
    of_group = [section.words("class"), section.words("detector")]
    if axes:
        of_group.append(section.Column("setting", lambda row: setting_label(axes, row), words=True))
    of_group.append(section.METRIC)

    biases = ("bias", "bias_low", "bias_high")
    agreement = section.Table.of(
        "Rank agreement of simulated clouds with recorded ones",
        rank_agreement(run),
        [
            *of_group,
            section.numbers("placements", "n", ".0f"),
            section.coefficient("ρ", "spearman"),
            section.coefficient("τ", "kendall"),
            section.numbers("p of ρ", "spearman_p", ".2g"),
            section.in_points("bias (points)", biases, "+z.1f"),
            section.words("note"),
        ],
        name="recorded-clouds",
        units=dict.fromkeys(biases, "points"),
    )
    each = section.Table.of(
        "Each placement on recorded and on simulated clouds",
        pairs,
        [
            *of_group,
            section.words("placement"),
            *(section.numbers(f"{kind} (%)", kind, ".1f") for kind in KINDS),
        ],
        name="recorded-clouds-placements",
        units=dict.fromkeys(KINDS, "%"),
    )
    title = "Do simulated clouds rank placements as recorded ones do?"
    return section.Section(title, [_NOTE], tables=[agreement, each.first(50)])


CLOUDS = "scene.clouds"  # the axis over recorded and simulated clouds of the same placements
KINDS = ("recorded", "simulated")


def side_by_side(run: RunFolder) -> pd.DataFrame:
    """Pair AP or recall of detectors on recorded clouds with those on simulated ones.

    One row per (class, detector, further axes, placement) with both: metric and iou, the
    headline's, and means over seeds in columns `recorded` and `simulated`, percent. Empty unless
    `CLOUDS` is an axis with both."""
    axes = [axis for axis in run.axes if axis != CLOUDS]
    keys = ["class", "detector", *axes, "metric", "iou", "placement"]
    results = _headline(run)
    if results.empty or set(results[CLOUDS]) < set(KINDS):
        return pd.DataFrame(columns=[*keys, *KINDS])
    means = results.groupby([*keys, CLOUDS], dropna=False, sort=False)["value"].mean()
    table = means.unstack(CLOUDS).dropna(subset=list(KINDS)).reset_index()
    return table[[*keys, *KINDS]].rename_axis(columns=None)


def rank_agreement(run: RunFolder) -> pd.DataFrame:
    """Correlate simulated means with recorded ones over placements where it has both.

    Rows of `tracking.findings.correlation.correlate`, and `bias`, `bias_low`, `bias_high`
    (`calibration`): simulated less recorded, points."""
    pairs = side_by_side(run)
    if pairs.empty:
        return pd.DataFrame()
    axes = [axis for axis in run.axes if axis != CLOUDS]
    results, keys = _headline(run), ["class", "detector", *axes]
    simulated = pairs[[*keys, "placement"]].assign(surrogate=KINDS[1], value=pairs[KINDS[1]])
    table = correlate(results[results[CLOUDS] == KINDS[0]], simulated, axes)
    table = table[table["n"] > 0]
    rows = []
    for key, means in pairs.groupby(keys, dropna=False, sort=False):
        estimates = calibration(*(means[kind].to_numpy(np.float64) for kind in KINDS[::-1]))
        rows.append(dict(zip(keys, key, strict=True)) | (estimates or {}))
    biases = pd.DataFrame(rows).reindex(columns=[*keys, "bias", "bias_low", "bias_high"])
    return table.merge(biases, on=keys, how="left")


def _headline(run: RunFolder) -> pd.DataFrame:
    """Select the results of every class by its headline metric; none without the axis."""
    if CLOUDS not in run.axes:
        return run.results.iloc[:0]
    names = (*run.classes, "all")
    return pd.concat([at_headline_iou(run.results, run.results, name) for name in names])
