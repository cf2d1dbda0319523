"""The table of docs/benchmark.md: a row a predictor, for each of the headline metrics."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import Any

import pandas as pd

from lidarplace.pog.surrogates.table import SURROGATES
from sweeps.benchmark.rigs import populations
from sweeps.benchmark.scores import reached, regret_at_random
from tracking.labels import surrogate_name
from tracking.numbers import DASH, digits, span

_WITH_INTERVAL = ("random", "all")
_LABELS = {
    "generalist": "**generalist** (three)",
    "perception_entropy": "perception entropy (Ma et al.)",
    "expected_ap": "E-AP",
    "ground_density": "ground density (Cai et al.)",
    "ground_uniformity": "ground uniformity (Cai et al.)",
}


def markdown_table(scores: pd.DataFrame, seconds: Mapping[str, float], metric: str) -> str:
    """All predictors by one metric, best first, after them the ceiling and a rig at random."""
    own = scores[(scores["metric"] == metric) & (scores["population"] == "all")]
    names = own.sort_values("rho", ascending=False)["predictor"]
    head = ["predictor", "s a rig", *(f"{name} {len(r)}" for name, r in populations().items())]
    lines = [[*head, "regret", "pairs"], ["---", *["---:"] * (len(head) + 1)]]
    lines += [_cells(scores, name, seconds[name], metric) for name in names]
    most = {name: reached(tuple(rigs), metric).ceiling for name, rigs in populations().items()}
    lost = regret_at_random(populations()["all"], metric)
    lines.append(["*ceiling*", "", *(digits(rho, "z.2f") for rho in most.values()), "", ""])
    lines.append(["*any rig*", "", *([""] * len(most)), digits(lost, ".1f"), "50 %"])
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def markdown_row(scores: pd.DataFrame, name: str, seconds: float, metric: str) -> str:
    """One predictor, to paste into the table of a metric."""
    return f"| {' | '.join(_cells(scores, name, seconds, metric))} |"


def rho_cell(row: Mapping[Hashable, Any]) -> str:
    """Spearman's rho with 95 %."""
    bounds = span(row["low"], row["high"], "z.2f")
    return digits(row["rho"], "z.2f") + (f" ({bounds})" if bounds != DASH else "")


def label(name: str) -> str:
    """Display name of a predictor."""
    return surrogate_name(name) if name in SURROGATES.own else _LABELS.get(name, name)


def _cells(scores: pd.DataFrame, name: str, seconds: float, metric: str) -> list[str]:
    own = scores[(scores["predictor"] == name) & (scores["metric"] == metric)]
    rows = {row["population"]: row for row in own.to_dict("records")}
    cells = [label(name), digits(seconds, ".2g")]
    for population in populations():
        row = rows[population]
        inside = population in _WITH_INTERVAL
        cells.append(rho_cell(row) if inside else digits(row["rho"], "z.2f"))
    every = rows["all"]
    return [*cells, digits(every["regret"], ".1f"), percent(every["right"])]


def percent(share: float) -> str:
    """A share of pairs."""
    return f"{share:.0%}".replace("%", " %") if share == share else DASH
