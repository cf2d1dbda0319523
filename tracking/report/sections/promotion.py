"""The section about promotion: what it saved and what it risked."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from tracking.figures.kit.style import text
from tracking.figures.of_sweeps.promotion import error_over_seconds, ranks_by_stage
from tracking.findings.promotion import FULL_TRAINING, Promoted, promoted, stage_ranks
from tracking.findings.promotion_agreement import agreement
from tracking.findings.promotion_savings import rung_costs, savings
from tracking.numbers import digits, number, signed
from tracking.pages.section import Section
from tracking.pages.tables import MOST_ROWS, Column, Table, numbers, slug, words
from tracking.run_folders.sweep import RunFolder

_HOW_TO_READ = (
    "Cheap stages ranked all placements, and only the best of each rung went on. Agreement is over "
    "the placements that reached the later stage. The earlier one chose them, so they are more "
    "alike than all placements are: a low coefficient among them does not show that the rung ranks "
    "badly, a high one does not show that it pruned the right ones. Whether a pruned placement "
    "would have been best cannot be seen here; only its full training shows it."
)


def promotion_section(run: RunFolder, promotions: pd.DataFrame) -> Section:
    """Figures and tables for every group of `promotions`, and what it saved."""
    section = Section("Promotion", [_HOW_TO_READ])
    rungs = run.sweep.promote
    found = list(promoted(promotions, run.trials, run.results, run.axes, rungs))
    surrogate_axes = [axis for axis in run.axes if axis in run.surrogates.columns]
    saved = savings(found, surrogate_axes)
    for group, spent in zip(found, saved.to_dict("records"), strict=False):
        pairs = agreement(group)
        costs = rung_costs(group)
        label = group.title if len(found) > 1 else ""
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
        return [
            "Several full trainings are equally best, so no rung is judged by where it put one."
        ]
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
