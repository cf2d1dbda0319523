"""The paper's own surrogates against its own AP, where it printed both."""

from dataclasses import replace

import pandas as pd

from lidarplace.base.metrics import HEADLINE_METRIC
from tracking.figures.of_sweeps.published import published_scatter
from tracking.findings.correlation import correlate
from tracking.labels import in_order, metric_label, surrogate_label
from tracking.numbers import number
from tracking.pages.section import Section
from tracking.pages.tables import Table
from tracking.published import published_detection, published_surrogates
from tracking.report.sections.correlation import correlation_table

_CLASS = "Car"
"""The one class of which the paper printed surrogates of three placements, or densities."""
_OVER = {"placements": "five placements", "densities": "Square at three densities"}
_KEYS = ["class", "metric", "iou", "detector"]


def add_published_surrogates(section: Section) -> None:
    """Add a figure over placements, one over densities of Square, and the coefficients of both."""
    results, surrogates = _printed_both()
    correlations = correlate(results, surrogates, ["over"])
    shown = (correlations["metric"] == HEADLINE_METRIC) & correlations["spearman"].notna()
    for over, title in _OVER.items():
        own = results[(results["over"] == over) & (results["metric"] == HEADLINE_METRIC)]
        values = surrogates[surrogates["over"] == over].pivot(
            index="placement", columns="surrogate", values="value"
        )
        tests = correlations[shown & (correlations["over"] == over)]
        own = own[own["detector"].isin(tests["detector"])]
        heading = f"The paper's own surrogates · {_CLASS}, {title}"
        plot = published_scatter(own, values, tests, heading)
        section.figures += [plot] if plot is not None else []
    section.notes.append(
        f"The paper's own surrogates, those of its traffic, are printed for {_CLASS}: S-MIG of "
        "five placements, and S-MIG, H_POG and IG of Square at three densities. Of three points "
        "no coefficient has a two-sided p-value below 0.33."
    )
    table = correlation_table(correlations[correlations["spearman"].notna()], ["over"])
    caption = "The paper's own surrogates with its own AP, 95 % intervals in brackets"
    section.tables.append(replace(table, name="published-surrogates", caption=caption))


def published_density_table() -> Table:
    """AP of Square and its surrogates, as the paper printed them, a column a density."""
    results, surrogates = (table[table["over"] == "densities"] for table in _printed_both())
    densities = list(dict.fromkeys(results["placement"]))[::-1]
    wide = results.pivot(index=["metric", "iou", "detector"], columns="placement", values="value")
    rows = [
        (f"{detector} · {metric_label(metric, iou)} (%)", *(f"{value:.2f}" for value in values))
        for (metric, iou, detector), values in zip(
            wide.index, wide[densities].to_numpy(), strict=True
        )
    ]
    known = surrogates.pivot(index="surrogate", columns="placement", values="value")[densities]
    rows += [
        (surrogate_label(name), *map(number, known.loc[name])) for name in in_order(known.index)
    ]
    data = pd.concat(
        [
            results[["detector", "metric", "iou", "placement", "value"]],
            surrogates[["surrogate", "placement", "value"]],
        ]
    )
    return Table(
        f"Published · {_CLASS}, Square",
        ("", *densities),
        tuple(rows),
        name="published-density",
        data=data.rename(columns={"placement": "density", "value": "value (% or nats)"}),
    )


def _printed_both() -> tuple[pd.DataFrame, pd.DataFrame]:
    """Results and surrogates as `correlate` has them; `over` says what `placement` holds."""
    results, surrogates = (
        _over(table[table["class"] == _CLASS])
        for table in (published_detection(), published_surrogates())
    )
    keys = ["over", "placement"]
    results = results.merge(surrogates[keys].drop_duplicates(), on=keys)
    # Figures that the paper repeats in several tables are the same.
    results = results.drop_duplicates([*keys, *_KEYS])
    return results.assign(seed=0, difficulty="all"), surrogates


def _over(table: pd.DataFrame) -> pd.DataFrame:
    """With `over`, and the density in the place of the placement where one was printed."""
    dense = table["density"] != ""
    return table.assign(
        over=dense.map({True: "densities", False: "placements"}),
        placement=table["density"].where(dense, table["placement"]),
    )
