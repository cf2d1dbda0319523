"""The section about promotion: what it saved and what it risked."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from tracking.figures.kit.style import OUTLINE, colour, figure, text
from tracking.findings.promotion import (
    FULL_TRAINING,
    Promoted,
    agreement,
    promoted,
    rung_costs,
    savings,
    stage_ranks,
)
from tracking.labels import digits, number, signed
from tracking.pages.section import MOST_ROWS, Column, Section, Table, numbers, slug, words
from tracking.report.analysis import Analysis

_HOW_TO_READ = (
    "Cheap stages ranked all placements, and only the best of each rung were kept. Agreement is "
    "over the placements that reached the later stage. The earlier one chose them, so they are "
    "more alike than all placements are: a low coefficient among them does not show that the "
    "rung ranks badly, a high one does not show that it pruned the right ones. Only a full "
    "training shows whether a pruned placement would have been best."
)


def promotion_section(found: Analysis) -> Section | None:
    """Figures and tables for every group of `promotions`, and what it saved."""
    run, promotions = found.whole, found.run.promotions
    if promotions is None or promotions.empty:
        return None
    section = Section("Promotion", [_HOW_TO_READ])
    rungs = run.sweep.promote
    parts = list(promoted(promotions, run.trials, run.results, run.axes, rungs))
    surrogate_axes = [axis for axis in run.axes if axis in run.surrogates.columns]
    saved = savings(parts, surrogate_axes)
    for group, spent in zip(parts, saved.to_dict("records"), strict=False):
        pairs = agreement(group)
        costs = rung_costs(group)
        label = group.title if len(parts) > 1 else ""
        title = f" · {label}" if label else ""
        start = f"{label}: " if label else ""
        section.notes += [
            start + sentence
            for sentence in (*_saved(spent, group.seeds), *_risked(pairs, group.ap))
        ]
        kept = costs["kept"].tolist()[:-1]
        plot = ranks_by_stage(stage_ranks(group), kept, f"Ranks, pruned ones grey{text(title)}")
        section.figures.append(plot)
        to_full = pairs[pairs["to_full"]]
        if len(to_full):
            each = float(costs["seconds_each"].iloc[-1])
            section.figures += error_over_seconds(to_full, each, text(title))
        section.tables += [_rungs(costs, title), _agreement(pairs, title)]
        section.tables.append(_ranking(group, title).first(MOST_ROWS))
    section.tables.append(_savings(saved))
    return section


def _saved(row: Mapping[Any, Any], seeds: int) -> list[str]:
    if np.isnan(row["without"]):
        return ["No full training finished, so what promotion saved is not known."]
    share = 100 * row["saved"] / row["without"]
    verdict = f"{share:.0f} % less" if share >= 0 else f"{-share:.0f} % more"
    return [
        f"Promotion spent {row['spent']:,.0f} s, {verdict} than the {row['without']:,.0f} s that "
        f"full trainings of all {row['placements']:,} placements with {seeds} "
        f"seed{'s' * (seeds > 1)} would have taken at the mean of those that were done. Point "
        "clouds are counted on neither side."
    ]


def _risked(pairs: pd.DataFrame, ap: pd.Series) -> list[str]:
    if (ap == ap.max()).sum() > 1:
        return ["Several full trainings are equally best, so no rung is rated by its rank of one."]
    said = []
    for row in pairs[pairs["to_full"]].to_dict("records"):
        sentence = (
            f"The best of the {len(ap)} trained in full, {row['best']}, was ranked "
            f"{row['best_rank']:,} of {row['ranked']:,} by {row['earlier']}, which kept "
            f"{row['kept']:,}"
        )
        if row["ranked"] > row["kept"] and row["best_rank"] >= row["kept"]:
            sentence += ": as the last of those kept, so a pruned one may well be better"
        said.append(f"{sentence}.")
    return said


def _rungs(costs: pd.DataFrame, title: str) -> Table:
    names = [_numbered(i, str(stage)) for i, stage in enumerate(costs["stage"], start=1)]
    columns = [
        words("stage"),
        numbers("placements", "placements", ","),
        numbers("without a value", "without_value", ","),
        Column("kept", lambda row: "–" if row["stage"] == FULL_TRAINING else f"{row['kept']:,}"),
        numbers("seconds", "seconds", _seconds),
        numbers("seconds a placement", "seconds_each", _seconds),
    ]
    return Table.of(
        f"Stages{title}",
        costs.assign(stage=names),
        columns,
        name=slug("promotion stages", title),
        data=costs,
        units=dict.fromkeys(("seconds", "seconds_each"), "s"),
    )


def _agreement(pairs: pd.DataFrame, title: str) -> Table:
    columns = [
        Column("earlier stage", lambda row: f"rung {row['rung']}", words=True),
        Column(
            "later stage",
            lambda row: FULL_TRAINING if row["to_full"] else f"rung {row['rung'] + 1}",
            words=True,
        ),
        numbers("n", "n", ""),
        numbers("Spearman ρ", "spearman", signed),
        numbers("p", "spearman_p", ".2g"),
        numbers("Kendall τ", "kendall", signed),
        numbers("p", "kendall_p", ".2g"),
        words("best of the later", "best"),
        Column(
            "its rank earlier", lambda row: f"{row['best_rank']:,} of {row['ranked']:,}", words=True
        ),
        Column(
            "first of the earlier",
            lambda row: (
                str(row["first"])
                + (f" (rank {row['first_rank']:,})" if row["first_rank"] > 1 else "")
            ),
            words=True,
        ),
        Column(
            "worse than the best by",
            lambda row: f"{row['regret']:.2f} AP" if row["to_full"] else number(row["regret"]),
        ),
    ]
    return Table.of(
        f"Agreement of stages, among placements of both{title}",
        pairs,
        columns,
        name=slug("promotion agreement", title),
    )


def _ranking(group: Promoted, title: str) -> Table:
    """Rank and value of every placement at every stage, those that came farthest first."""
    ranks = stage_ranks(group)
    values = group.rungs.pivot(index="placement", columns="rung", values="value")
    shown = [values[rung].reindex(ranks.index).map(number) for rung in sorted(values.columns)]
    shown.append(group.ap.reindex(ranks.index).map(lambda ap: digits(ap, ".1f")))
    order = ranks.sort_values(ranks.columns[::-1].tolist(), kind="stable").index
    rows = tuple(
        (
            str(name),
            *(
                cell[name] if np.isnan(rank) else f"{cell[name]} ({rank:.0f})"
                for cell, rank in zip(shown, ranks.loc[name], strict=True)
            ),
        )
        for name in order
    )
    stages = [_numbered(i, name) for i, name in enumerate(group.stages, start=1)]
    head = ("placement", *stages)
    rungs = zip(stages, ranks.columns, strict=True)
    data = pd.DataFrame({name: values[rung] for name, rung in rungs if rung in values})
    data[stages[-1]] = group.ap
    return Table(
        f"Values by stage, ranks in brackets{title}",
        head,
        rows,
        name=slug("promotion values", title),
        data=data.reindex(order).rename_axis("placement").reset_index(),
    )


def _savings(saved: pd.DataFrame) -> Table:
    seconds = {
        "surrogates": "surrogates (s)",
        "short": "short trainings (s)",
        "full": "full trainings (s)",
        "spent": "spent (s)",
        "without": "all in full, estimated (s)",
        "saved": "saved (s)",
    }
    columns = [
        words("group"),
        numbers("placements", "placements", ","),
        *(numbers(head, key, _seconds) for key, head in seconds.items()),
        Column("saved (%)", lambda row: _seconds(round(100 * row["saved"] / row["without"], 0))),
    ]
    units = dict.fromkeys(seconds, "s")
    return Table.of("What promotion saved", saved, columns, name="promotion-saved", units=units)


def _numbered(number: int, name: str) -> str:
    return name if name == FULL_TRAINING else f"rung {number}: {name}"


def _seconds(value: float) -> str:
    return digits(value, ",.0f" if abs(value) >= 100 else ".3g")


_TICKS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000)


def ranks_by_stage(ranks: pd.DataFrame, kept: Sequence[int], title: str) -> go.Figure:
    """Rank of every placement at every stage, pruned ones grey; a dash marks how far a rung kept.

    Args:
        ranks: `tracking.findings.promotion.stage_ranks`, the last column is the full training.
        kept: placements that each rung kept.
    """
    stages = [*(f"rung {i}" for i in range(1, len(kept) + 1)), "full training"]
    last = ranks.columns[-1]
    finalists = ranks[ranks[last].notna()].sort_values(last)
    pruned = ranks.drop(index=finalists.index)
    plot = figure(title, height=400)
    # Lines that end early, in one trace: a gap between two placements.
    lines = np.full((len(pruned), len(stages) + 1), np.nan)
    lines[:, :-1] = pruned
    plot.add_scatter(
        x=np.tile([*stages, stages[-1]], len(pruned)),
        y=lines.ravel(),
        mode="lines+markers",
        line={"color": OUTLINE, "width": 1},
        marker={"size": 4},
        opacity=0.45,
        text=np.repeat([text(name) for name in pruned.index], len(stages) + 1),
        hovertemplate="%{text}, %{x}: rank %{y}<extra></extra>",
        showlegend=False,
    )
    for i, name in enumerate(finalists.index):
        plot.add_scatter(
            x=stages,
            y=finalists.loc[name].to_numpy(),
            mode="lines+markers",
            line={"color": colour(i), "width": 2},
            marker={"size": 8},
            name=text(name),
            hovertemplate=f"{text(name)}, %{{x}}: rank %{{y}}<extra></extra>",
        )
    plot.add_scatter(
        x=stages[:-1],
        y=[count + 0.5 for count in kept],
        mode="markers",
        marker={"symbol": "line-ew-open", "size": 22, "line": {"width": 2}, "color": OUTLINE},
        name="kept up to here",
        hoverinfo="skip",
    )
    worst = float(np.nanmax(ranks.to_numpy()))
    plot.update_yaxes(
        title="rank",
        type="log",
        range=[np.log10(1.25 * worst), np.log10(0.8)],
        tickvals=[rank for rank in _TICKS if rank <= worst],
    )
    plot.update_xaxes(categoryorder="array", categoryarray=stages, range=[-0.3, len(stages) - 0.7])
    plot.update_layout(legend={"orientation": "h", "y": -0.14, "yanchor": "top"})
    return plot


def error_over_seconds(to_full: pd.DataFrame, seconds_full: float, title: str) -> list[go.Figure]:
    """Errors of every rung over its seconds for a placement; a star is the full training.

    The share of pairs of placements that the rung orders unlike the full training, (1 − τ) / 2,
    unless no rung has a τ; and how much less AP the placement that it ranks highest has than the
    best.

    Args:
        to_full: rows of `tracking.findings.promotion.agreement` with the full training,
            some.
        seconds_full: of the full training of a placement, all seeds.
        title: plotly text that ends both titles.
    """
    figures = []
    if to_full["kendall"].notna().any():
        share = _errors(to_full, 50 * (1 - to_full["kendall"]), seconds_full)
        share.update_layout(title={"text": f"Pairs ordered unlike full training{title}"})
        share.update_yaxes(title="share of pairs (%)")
        figures.append(share)
    lost = _errors(to_full, to_full["regret"], seconds_full)
    lost.update_layout(title={"text": f"AP lost by taking the first of a rung{title}"})
    lost.update_yaxes(title="points of AP")
    return [*figures, lost]


def _errors(to_full: pd.DataFrame, error: pd.Series, seconds_full: float) -> go.Figure:
    names = [*to_full["earlier"], "full training"]
    seconds = [*to_full["seconds"], seconds_full]
    plot = figure("", height=400)
    plot.add_scatter(
        x=seconds,
        y=[*error, 0.0],
        mode="markers+text",
        marker={
            "size": [*([10] * len(to_full)), 14],
            "symbol": [*(["circle"] * len(to_full)), "star"],
            "color": [*([colour(0)] * len(to_full)), colour(5)],
        },
        text=[*(f"rung {i}" for i in to_full["rung"]), "full"],
        textposition="top center",
        cliponaxis=False,
        customdata=[text(name) for name in names],
        hovertemplate="%{customdata}<br>%{x:.3g} s: %{y:.3g}<extra></extra>",
        showlegend=False,
    )
    known = [value for value in seconds if value > 0]
    plot.update_xaxes(
        type="log",
        range=np.log10([min(known) / 3, max(known) * 3]),
        dtick=1,
        title="seconds a placement",
    )
    top = float(np.nanmax([*error, 0.0])) or 1.0
    plot.update_yaxes(range=[-0.08 * top, 1.2 * top])
    return plot
