"""The section of the sampling error of the POG."""

from collections.abc import Sequence

import pandas as pd
import plotly.graph_objects as go

from lidarplace.pog.surrogates.table import HEADLINE_SURROGATES
from tracking.figures.kit.style import add_menu, colour, error_bars, figure, text
from tracking.findings.groups import by_setting, studied
from tracking.findings.sampling_error import paired_differences
from tracking.labels import in_order, surrogate_label, surrogate_name, surrogate_unit
from tracking.numbers import number
from tracking.pages.section import Section
from tracking.pages.tables import Table, numbers, slug, words
from tracking.report.headline import separation_sentences
from tracking.run_folders.sweep import RunFolder

MOST_INTERVALS = 20
"""Placements whose sampling errors are shown: every pair of them is compared."""


def sampling_error_section(run: RunFolder, ranked: list[str]) -> Section:
    """How much the surrogates would change with other frames."""
    section = Section("Surrogates: sampling error of the POG", columns=2)
    tables = {"sampling_error": run.sampling_error, "pog_resamples": run.pog_resamples}
    missing = [name for name, table in tables.items() if table is None or table.empty]
    if run.sampling_error is None or run.pog_resamples is None or missing:
        names = " and ".join(f"{name}.parquet" for name in missing)
        section.notes.append(f"The run folder has no {names}.")
        return section
    section.notes.append(
        "The POG is counted over some frames and not over all traffic. Blocks of consecutive "
        "frames of a route were drawn again with replacement, the same for every placement. "
        "Intervals are 1.96 standard deviations to each side, nominally 95 % and somewhat less "
        "with few blocks. Entropies from few frames are too low; the estimated bias is taken off "
        "the interval, not off the value."
    )
    section.notes += studied(run, run.sampling_error)
    known = set(run.sampling_error["placement"])
    shown = [name for name in ranked if name in known][:MOST_INTERVALS]
    if len(shown) < len(known):
        section.notes.append(
            f"The best {len(shown)} of {len(known):,} placements; sampling_error.parquet has all."
        )
    best, draws = (
        table[table["placement"].isin(shown)] for table in (run.sampling_error, run.pog_resamples)
    )
    resamples = dict(by_setting(draws, run.axes))
    for title, part in by_setting(best, run.axes):
        pairs = paired_differences(
            part[part["surrogate"].isin(HEADLINE_SURROGATES)], resamples[title]
        )
        for name, own in part.groupby("class", sort=False):
            label = f"{name} · {title}" if title else str(name)
            section.notes += separation_sentences(pairs[pairs["class"] == name], label)
            section.figures.append(
                intervals(own, label, [name for name in run.placements if name in shown])
            )
            section.tables.append(sampling_error_table(own, label))
    return section


def sampling_error_table(estimates: pd.DataFrame, title: str) -> Table:
    """Estimates of `lidarplace.pog.surrogates.sampling_error` of one class as text."""
    columns = [
        words("surrogate", show=surrogate_label),
        words("placement"),
        numbers("value", "value", number),
        numbers("sd", "sd", number),
        numbers("bias", "bias", number),
        numbers("95 % low", "low", number),
        numbers("95 % high", "high", number),
    ]
    order = in_order(estimates["surrogate"])
    rows = estimates.sort_values(
        "surrogate", key=lambda names: names.map(order.index), kind="stable"
    )
    caption = f"Sampling error · {title}"
    if "blocks" in estimates:
        caption += (
            f" · {estimates['resamples'].iloc[0]} draws of {estimates['blocks'].iloc[0]} blocks"
        )
    units = [surrogate_unit(name) for name in estimates["surrogate"]]
    return Table.of(
        caption,
        rows,
        columns,
        wide=True,
        name=slug("sampling error", title),
        data=estimates.assign(unit=units),
    )


def intervals(estimates: pd.DataFrame, title: str, placements: Sequence[str]) -> go.Figure:
    """A row a placement: its interval, and the value of the log as a hollow point.

    Args:
        estimates: of one class: placement, surrogate, value, low, high.
        placements: in the order from top to bottom.
    """
    plot = figure(text(title), height=120 + 34 * len(placements), margin={"t": 72})
    names = in_order(estimates["surrogate"])
    first = "expected_ig" if "expected_ig" in names else names[0]
    for name in names:
        own = estimates[estimates["surrogate"] == name].set_index("placement")
        own = own.reindex([p for p in placements if p in own.index])
        middle = (own["low"] + own["high"]) / 2
        labels = [text(placement) for placement in own.index]
        plot.add_scatter(
            x=middle.to_numpy(),
            y=labels,
            error_x=error_bars(own["high"] - middle, thickness=2),
            mode="markers",
            marker={"size": 9, "color": colour(0)},
            name="estimate, bias taken off",
            visible=name == first,
            hovertemplate="%{y}: %{x:,.5g}<extra></extra>",
        )
        plot.add_scatter(
            x=own["value"].to_numpy(),
            y=labels,
            mode="markers",
            marker={"size": 9, "color": colour(5), "symbol": "diamond-open"},
            name="value of this log",
            visible=name == first,
            hovertemplate="%{y}: %{x:,.5g}<extra></extra>",
        )
    plot.update_layout(
        xaxis_title=surrogate_label(first), legend={"orientation": "h", "y": 1, "yanchor": "bottom"}
    )
    changes = [
        (
            {"visible": [name == other for other in names for _ in range(2)]},
            {"xaxis.title.text": surrogate_label(name)},
        )
        for name in names
    ]
    labels = [surrogate_name(name) for name in names]
    add_menu(plot, labels, changes, names.index(first), right=True, y=1.02)
    plot.update_yaxes(autorange="reversed")
    return plot
