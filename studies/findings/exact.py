"""What generalists say of rigs that are mounted exactly, and of the same with real mounts."""

from __future__ import annotations

from functools import cache

import pandas as pd
from predicting import GENERALIST, PREDICTORS, every_predictor, of, read
from properties import properties
from rig_results import SHORT, head_of, label, number, table
from scipy import stats

from lidarplace import PAPER_PLACEMENTS

TARGETS = ("car", "recall")


def exact_table() -> str:
    """The paper's eight: AP and recall mounted exactly, with real mounts, and the change."""
    overlap = properties()["redundancy"]
    names = list(PAPER_PLACEMENTS)
    order = both("car").loc[names].sort_values("exact", ascending=False).index
    rows = []
    for name in order:
        cells = [str(name), f"{overlap[name]:.0%}".replace("%", " %")]
        for target in TARGETS:
            exact, real = both(target).loc[name]
            cells += [number(exact, 1), number(real, 1), number(real - exact, 1, sign=True)]
        rows.append(cells)
    heads = [
        f"{head_of(target)}, {kind}" for target in TARGETS for kind in ("exact", "real", "change")
    ]
    return table(["", "rings that coincide", *heads], rows)


def seen_table() -> str:
    """Spearman's rho of each predictor with what generalists say of exact and of real mounts."""
    rows = [
        [label(name), *(_goes_with(name, t, kind) for t in TARGETS for kind in ("exact", "real"))]
        for name in PREDICTORS
        if name != GENERALIST
    ]
    heads = [f"{head_of(target)}, {kind}" for target in TARGETS for kind in ("exact", "real")]
    return table(["", *heads], rows)


def survives(target: str, eight: bool = False) -> str:
    """Spearman's rho of exact and real mounts, over all rigs or the paper's eight."""
    own = both(target).loc[list(PAPER_PLACEMENTS)] if eight else both(target)
    return number(stats.spearmanr(own["exact"], own["real"]).statistic)


def gain_by_overlap(target: str) -> str:
    """Spearman's rho of what real mounts gain with the share of rings that coincide."""
    own = both(target)
    gain = own["real"] - own["exact"]
    return number(stats.spearmanr(gain, properties()["redundancy"].loc[gain.index]).statistic)


def gain(target: str, rig: str | None = None) -> str:
    """What real mounts give a rig, or the median rig, points."""
    own = both(target)
    gains = own["real"] - own["exact"]
    return number(float(gains.median() if rig is None else gains[rig]), 1, sign=True)


@cache
def both(target: str) -> pd.DataFrame:
    """Means over generalists of exact and of real mounts, by rig."""
    real = read("main_results").query("evaluator == 'generalist'")
    tables = {"exact": read("exact_results"), "real": real}
    return pd.DataFrame(
        {
            kind: of(rows, SHORT[target]).groupby("placement")["value"].mean()
            for kind, rows in tables.items()
        }
    )


def _goes_with(name: str, target: str, kind: str) -> str:
    own, wide = both(target), every_predictor(SHORT[target])
    if name not in wide.columns:
        return "–"
    return number(stats.spearmanr(wide[name].loc[own.index], own[kind]).statistic)
