"""First screen of a report: which surrogate predicts AP and recall, and S-MIG against AP."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from tracking import labels
from tracking.figures.kit.style import DIVERGING, add_menu, figure, text
from tracking.kitti_iou import at_headline_iou, at_headline_ious
from tracking.pages.section import Section
from tracking.report.analysis import Analysis
from tracking.report.headline import class_label
from tracking.report.sections.correlation import is_headline, scatters

_PALE = 0.3  # share of its colour that a cell keeps if its interval holds zero
_LEGEND = (
    "ρ is Spearman's, over placements. Orange rises with the metric, blue falls, pale has a 95 % "
    "interval that holds zero, or none. Bold is the strongest of its column."
)


def coefficient_map_section(analysis: Analysis) -> Section | None:
    """Show ρ of each surrogate with each metric, and S-MIG against AP; None without any ρ."""
    if not analysis.predictors:
        return None
    of_first = [one for one in analysis.predictors if analysis.groups[0].includes(one.group)]
    sentences = [one.sentence for one in of_first if is_headline(analysis.run, one.group)]
    figures = [coefficient_map(dict(coefficient_charts(analysis))), next(scatters(analysis))]
    title = "Which surrogate predicts AP and recall?"
    notes = [*dict.fromkeys((*sentences[:1], *sentences[-1:])), _LEGEND]  # of AP and of recall
    return Section(title, notes, figures, columns=2, place="head")


def coefficient_charts(analysis: Analysis) -> Iterator[tuple[str, pd.DataFrame]]:
    """Yield the coefficients of a map by its name: of all classes, and of each alone.

    Rows of `correlate` with the label of their `column`."""
    results, names = analysis.run.results, (*analysis.run.classes, "all")
    for group in analysis.groups:
        tests = group.of(analysis.correlations)
        metrics = zip(tests["metric"], tests["iou"], strict=True)
        named = [text(labels.metric_label(*metric)) for metric in metrics]
        tests = tests.assign(column=[name.replace(" @ ", "<br>@ ") for name in named])
        headlines = pd.concat([at_headline_iou(tests, results, name) for name in names])
        of_class = headlines["class"].map(
            lambda name: f"{text(class_label(name)).replace(' ', '<br>')}<br>"
        )
        yield (
            group.title if group.varies else "headline metrics",
            headlines.assign(column=of_class + headlines["column"]),
        )
        if not group.varies:
            for name in names:
                yield class_label(name), at_headline_ious(tests, results, name)


def coefficient_map(charts: Mapping[str, pd.DataFrame]) -> go.Figure:
    """Draw ρ of surrogates, a row each, with metrics, a column each, and a menu of the charts.

    A chart has rows of `correlate` with the label of their `column`; those without ρ are left out.
    """
    defined = {name: chart[chart["spearman"].notna()] for name, chart in charts.items()}
    defined = {name: chart for name, chart in defined.items() if len(chart)}
    rows = labels.in_order(pd.concat([*defined.values()])["surrogate"])
    cells = [coefficient_cells(chart, rows) for chart in defined.values()]
    plot = figure("Rank correlation ρ with AP and recall", height=145 + 22 * len(rows))
    plot.add_heatmap(
        **cells[0],
        y=[text(labels.surrogate_short(name)) for name in rows],
        zmin=-1.0,
        zmax=1.0,
        colorscale=DIVERGING,
        showscale=False,
        xgap=2,
        ygap=2,
        texttemplate="%{text}",
        textfont={"color": "#1d2126", "size": 11},
        hovertemplate="%{y}, %{x}<br>%{customdata}<extra></extra>",
        hoverongaps=False,
    )
    plot.update_xaxes(showgrid=False, fixedrange=True, tickangle=0, tickfont={"size": 11})
    plot.update_yaxes(autorange="reversed", showgrid=False, fixedrange=True)
    plot.update_layout(margin={"t": 72, "l": 110})
    if len(defined) == 1:
        return plot
    changes = [[{key: [values] for key, values in cell.items()}] for cell in cells]
    return add_menu(plot, [text(name) for name in defined], changes, y=1.02)


def coefficient_cells(chart: pd.DataFrame, rows: list[str]) -> dict[str, Any]:
    """Make columns, shades, words and hover text of the cells of a chart, by plotly's names."""
    columns = list(dict.fromkeys(chart["column"]))
    shades = np.full((len(rows), len(columns)), np.nan)
    words, hover = np.full(shades.shape, "", object), np.full(shades.shape, "", object)
    strongest = chart.groupby("column")["spearman"].transform(lambda rho: rho.abs().max())
    for row, most in zip(chart.to_dict("records"), strongest, strict=True):
        place = rows.index(row["surrogate"]), columns.index(row["column"])
        rho, low, high = (row[f"spearman{end}"] for end in ("", "_low", "_high"))
        shades[place] = rho if low > 0 or high < 0 else _PALE * rho
        rounded = labels.signed(rho)
        words[place] = f"<b>{rounded}</b>" if abs(rho) > most - 1e-9 else rounded
        interval = labels.interval(low, high)
        hover[place] = f"ρ = {rounded} {interval}, p = {row['spearman_p']:.2g}, n = {row['n']}"
    return {
        "x": columns,
        "z": shades.tolist(),
        "text": words.tolist(),
        "customdata": hover.tolist(),
    }
