"""Coefficients over several sweeps, each sweep's own level removed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from lidarplace.base.metrics import headline_metric
from lidarplace.pog.surrogates.table import HEADLINE_SURROGATES
from tracking.findings.groups import groups
from tracking.findings.paired import with_sums
from tracking.findings.summary import seed_means, surrogates_of
from tracking.kitti_iou import judged
from tracking.labels import metric_name
from tracking.numbers import signed
from tracking.pages.tables import SURROGATE, Column, Table, numbers, words
from tracking.run_folders.sweep import RunFolder

LEAST = 3
"""Placements of a group that counts."""


def pooled_table(runs: Sequence[RunFolder]) -> Table | None:
    """Spearman's rho within sweeps, pooled, by class and surrogate; None if none has results."""
    pairs = pd.concat([_pairs(run, number) for number, run in enumerate(runs)])
    rows = []
    keys = ["class", "metric", "surrogate"]
    for key, own in pairs.groupby(keys, sort=False) if len(pairs) else ():
        ranks = own.groupby(["sweep", "group"])[["value", "ap"]].rank()
        centred = ranks - ranks.groupby([own["sweep"], own["group"]]).transform("mean")
        length = np.sqrt((centred**2).sum())
        if own["sweep"].nunique() < 2 or not (length > 0).all():
            continue
        rho = float((centred["value"] * centred["ap"]).sum() / length.prod())
        count = own.groupby(["sweep", "group"]).ngroups
        rows.append((*key, own["sweep"].nunique(), count, len(own), rho))
    if not rows:
        return None
    columns = [*keys, "sweeps", "groups", "values", "pooled_spearman"]
    data = pd.DataFrame(rows, columns=columns)
    shown = [
        words("class"),
        Column("metric", lambda row: metric_name(row["metric"]), words=True),
        SURROGATE,
        numbers("sweeps", "sweeps", ""),
        numbers("groups", "groups", ""),
        numbers("values", "values", ""),
        numbers("ρ within sweeps", "pooled_spearman", signed),
    ]
    caption = "Pooled over sweeps, the level of each removed"
    return Table.of(caption, data, shown, name="pooled")


def _pairs(run: RunFolder, sweep: int) -> pd.DataFrame:
    """Surrogate and headline metric of every placement of every group with `LEAST` of them."""
    means, surrogates = seed_means(run.results, run.axes), with_sums(run.surrogates, run.axes)
    parts = []
    for number, group in enumerate(groups(run)):
        for name in (*run.classes, "all"):
            metric = headline_metric(name)
            own = judged(group.of(means), run.results, name)
            own = own[own["seeds"] > 0].set_index("placement")
            values = surrogates_of(surrogates, group.setting, name)
            for surrogate in HEADLINE_SURROGATES:
                if surrogate not in values:
                    continue
                both = pd.DataFrame({"value": values[surrogate], "ap": own["mean"]}).dropna()
                if len(both) >= LEAST:
                    kind = {"class": name, "metric": metric, "surrogate": surrogate}
                    parts.append(both.assign(sweep=sweep, group=number, **kind))
    columns = ["value", "ap", "sweep", "group", "class", "metric", "surrogate"]
    return pd.concat(parts) if parts else pd.DataFrame(columns=columns)
