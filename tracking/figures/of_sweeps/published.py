"""Published AP and recall: against a surrogate, and against own results."""

from collections.abc import Hashable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from tracking.figures.kit.named_points import label_places, labels_on_top, room_on_top
from tracking.figures.kit.style import (
    OUTLINE,
    add_menu,
    colour,
    error_bars,
    figure,
    legend_below,
    symbol,
    text,
)
from tracking.labels import (
    in_order,
    interval,
    metric_label,
    signed,
    surrogate_label,
    surrogate_name,
)


def published_scatter(
    published: pd.DataFrame, surrogates: pd.DataFrame, correlations: pd.DataFrame, title: str
) -> go.Figure | None:
    """A line of points a detector, in the order of the surrogate that the menu chooses.

    The legend has the coefficient of every detector, with interval and p-value.

    Args:
        published: placement, detector, metric, iou and value (percent) of one class and metric.
        surrogates: placements as rows, surrogates as columns.
        correlations: rows of `correlate` for the same, of all detectors.

    Returns:
        None if no surrogate is known.
    """
    menu = [name for name in in_order(surrogates.columns) if surrogates[name].notna().all()]
    if not menu:
        return None
    detectors = list(dict.fromkeys(published["detector"]))
    label = metric_label(*published.iloc[0][["metric", "iou"]])
    wide = published.pivot(index="placement", columns="detector", values="value")[detectors]

    def data(surrogate: str) -> dict[str, list[list[Any]]]:
        x = surrogates[surrogate].reindex(wide.index)
        order = x.sort_values(kind="stable").index
        values: dict[str, list[list[Any]]] = {"x": [], "y": [], "text": []}
        for detector in detectors:
            own = wide.loc[order, detector].dropna()
            values["x"].append(x[own.index].tolist())
            values["y"].append(own.tolist())
            values["text"].append([text(name) for name in own.index])
        return values

    def places(surrogate: str) -> dict[str, Any]:
        """A label and a line for every placement: its points are one above the other."""
        x = surrogates[surrogate].reindex(wide.index)
        line = {"color": OUTLINE, "width": 1, "dash": "dot"}
        upright = {"type": "line", "yref": "paper", "y0": 0, "y1": 1, "line": line}
        return {
            "annotations": labels_on_top(x.tolist(), [text(name) for name in x.index]),
            "shapes": [{**upright, "x0": value, "x1": value} for value in x],
        }

    known = {(row["surrogate"], row["detector"]): row for row in correlations.to_dict("records")}

    def names(surrogate: str) -> list[str]:
        return [f"{text(name)}: {_coefficient(known.get((surrogate, name)))}" for name in detectors]

    start, first = data(menu[0]), names(menu[0])
    room = room_on_top([str(name) for name in wide.index])
    plot = figure(title, height=440 + room, margin={"t": 84 + room})
    for i, detector in enumerate(detectors):
        plot.add_scatter(
            x=start["x"][i],
            y=start["y"][i],
            text=start["text"][i],
            mode="lines+markers",
            line={"color": colour(i), "width": 1},
            marker={"size": 9, "symbol": symbol(i)},
            name=first[i],
            hovertemplate=f"{text(detector)}, %{{text}}<br>%{{x:.6g}}<br>%{{y:.2f}} %"
            "<extra></extra>",
        )
    plot.update_xaxes(title=surrogate_label(menu[0]), showgrid=False)
    plot.update_yaxes(title=f"{label} (%)")
    plot.update_layout(**places(menu[0]))
    changes = [
        (
            data(name) | {"name": names(name)},
            {"xaxis.title.text": surrogate_label(name), "xaxis.autorange": True, **places(name)},
        )
        for name in menu
    ]
    labels = [surrogate_name(name) for name in menu]
    add_menu(plot, labels, changes, y=1, pad={"b": room, "t": 0})
    legend_below(plot)
    return plot


def _coefficient(row: Mapping[Hashable, Any] | None) -> str:
    if row is None or np.isnan(row["spearman"]):
        return "no ρ"
    span = interval(row["spearman_low"], row["spearman_high"])
    return f"ρ = {signed(row['spearman'])} {span}, p = {row['spearman_p']:.2g}, n = {row['n']}"


def against_own(pairs: pd.DataFrame, title: str, placements: Sequence[str]) -> go.Figure:
    """Published values against own ones, a colour a detector; bars are intervals.

    Args:
        pairs: placement, series, value (published, percent), mean, low, high (own, percent).
    """
    plot = figure(f"Published and own · {title}", height=420)
    # Points of one placement and network lie above each other: the highest has the label.
    table = pairs.sort_values("mean", ascending=False, kind="stable").reset_index(drop=True)
    again = table.duplicated(["placement", "value"])
    table["label"] = table["placement"].astype(object).mask(again, "").map(text)
    x, y, bars = (table[key].to_numpy(np.float64) for key in ("value", "mean", "high"))
    table["place"] = label_places(x, y, table["label"].tolist(), bars - y)
    for i, series in enumerate(dict.fromkeys(pairs["series"])):
        own = table[table["series"] == series].set_index("placement")
        own = own.loc[[name for name in placements if name in own.index]]
        plot.add_scatter(
            x=own["value"].to_numpy(),
            y=own["mean"].to_numpy(),
            error_y=error_bars((own["high"] - own["mean"]).fillna(0), thickness=1.5, color=OUTLINE),
            mode="markers+text",
            text=own["label"].tolist(),
            textposition=own["place"].tolist(),
            customdata=[text(name) for name in own.index],
            textfont={"size": 11},
            cliponaxis=False,
            marker={"size": 10, "color": colour(i), "symbol": symbol(i)},
            name=text(series),
            showlegend=True,
            hovertemplate="%{customdata}<br>published %{x:.1f} %<br>own %{y:.1f} %"
            "<extra>%{fullData.name}</extra>",
        )
    plot.update_xaxes(title="published (%)")
    plot.update_yaxes(title="own (%)")
    legend_below(plot)
    return plot
