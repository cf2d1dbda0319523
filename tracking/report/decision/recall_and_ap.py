"""The section of what the rigs find: recall and AP in one chart."""

from __future__ import annotations

import pandas as pd

from lidarplace.base.metrics import headline_metric
from tracking.figures.of_sweeps.side_by_side import side_by_side
from tracking.kitti_iou import headline_iou, judged
from tracking.labels import metric_label
from tracking.numbers import percent
from tracking.pages.section import Section
from tracking.report.decision.recommendation import Recommendation
from tracking.report.headline import class_label
from tracking.run_folders.sweep import RunFolder


def recall_and_ap_section(
    run: RunFolder, found: Recommendation, means: pd.DataFrame, enough: bool
) -> Section:
    """Every class' AP and the recall of all objects, with intervals, the best rig on top.

    Args:
        means: `seed_means` of the run.
        enough: whether the evidence allows to say how likely each is to be the best.
    """
    section = Section("What they find", columns=1)
    own = found.group.of(means)
    alone = len(found.ranked) <= 2
    columns = {}
    for name in found.ranked:
        metric = metric_label(headline_metric(name), headline_iou(run.results, name))
        table = judged(own, run.results, name).set_index("placement")
        label = metric if alone else f"{metric}, {class_label(name)}"
        columns[label] = table.assign(
            low=(table["mean"] - table["half"]).clip(lower=0),
            high=(table["mean"] + table["half"]).clip(upper=100),
        )[["mean", "low", "high"]]
    rows = found.shown
    odds = [percent(share) for share in found.best.sure.loc[rows]] if enough else []
    section.figures.append(side_by_side(columns, rows, "Recall and AP", "percent", odds))
    section.notes.append(
        "Means over seeds. Bars are 95 % intervals for a comparison, over seeds"
        + (" and over test objects, which all rigs share." if found.best.sample else ".")
        if any(table["low"].notna().any() for table in columns.values())
        else "One seed each: how much the training scatters is unknown, so there are no bars."
    )
    return section
