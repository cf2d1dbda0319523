"""Tables of docs/benchmark.md: a row a predictor."""

from collections.abc import Hashable, Mapping
from typing import Any

import pandas as pd

from lidarplace.pog.surrogates.table import SURROGATES
from sweeps.benchmark.rigs import populations
from tracking.labels import DASH, digits, span

_LABELS = {
    "generalist": "**generalist** (three)",
    "pretrained": "**pretrained**",
    "perception_entropy": "perception entropy (Ma et al.)",
    "expected_ap": "E-AP",
    "ground_density": "ground density (Cai et al.)",
    "ground_uniformity": "ground uniformity (Cai et al.)",
}


def markdown_table(scores: pd.DataFrame, seconds: Mapping[str, float], metric: str) -> str:
    """List all predictors by one metric, best first, below the ceiling."""
    of_metric = scores[(scores["metric"] == metric) & (scores["population"] == "all")]
    names = of_metric.sort_values("rho", ascending=False)["predictor"]
    head = ["predictor", "s a rig", *(f"{name} {len(r)}" for name, r in populations().items())]
    most = scores[scores["metric"] == metric].drop_duplicates("population")["ceiling"]
    lines = [[*head, "regret", "pairs"], ["---", *["---:"] * (len(head) + 1)]]
    lines.append(["*ceiling*", "", *(digits(rho, ".2f") for rho in most), "", ""])
    rows = [markdown_row(scores, name, seconds, metric) for name in names]
    return "\n".join([*(f"| {' | '.join(cells)} |" for cells in lines), *rows])


def rho_cell(row: Mapping[Hashable, Any]) -> str:
    """Format Spearman's rho with its 95 % interval."""
    bounds = span(row["low"], row["high"], "z.2f")
    return digits(row["rho"], "z.2f") + (f" ({bounds})" if bounds != DASH else "")


def percent(share: float) -> str:
    """Format a share of pairs."""
    return f"{100 * share:.0f} %" if share == share else DASH


def markdown_row(scores: pd.DataFrame, name: str, seconds: Mapping[str, float], metric: str) -> str:
    """Write one predictor, to paste into the table of a metric."""
    label = SURROGATES[name].label if name in SURROGATES.own else _LABELS.get(name, name)
    of_predictor = scores[(scores["predictor"] == name) & (scores["metric"] == metric)]
    rows = {row["population"]: row for row in of_predictor.to_dict("records")}
    inside = [
        rho_cell(row) if population in ("random", "all") else digits(row["rho"], "z.2f")
        for population, row in rows.items()
    ]
    lost = [digits(rows["all"]["regret"], ".1f"), percent(rows["all"]["right"])]
    return f"| {' | '.join([label, digits(seconds[name], '.2g'), *inside, *lost])} |"
