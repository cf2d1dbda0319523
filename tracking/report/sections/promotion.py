"""Promotion: what it saved and what it risked."""

from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from tracking.findings.promotion import Promoted, promoted, savings, stage_ranks, stages
from tracking.labels import DASH, digits, number, signed
from tracking.pages.section import MOST_ROWS, Column, Section, Table, numbers, slug, words
from tracking.report.analysis import Analysis

_HOW_TO_READ = (
    "Cheap stages ranked all placements, and only the best of each rung were kept. Agreement is "
    "with the full training, over the placements that reached it. The earlier stages chose them, "
    "so they are more alike than all placements are: a low coefficient among them does not show "
    "that the rung ranks badly, a high one does not show that it pruned the right ones. Only a "
    "full training shows whether a pruned placement would have been best."
)


def promotion_section(analysis: Analysis) -> Section | None:
    """Show savings, risks and two tables for every group; None without promotion."""
    run, promotions = analysis.whole, analysis.run.promotions
    if promotions is None or promotions.empty:
        return None
    section = Section("Promotion", [_HOW_TO_READ])
    parts = list(promoted(run))
    for group in parts:
        table = stages(group)
        label = group.title if len(parts) > 1 else ""
        start, end = (f"{label}: ", f" · {label}") if label else ("", "")
        section.notes.append(start + _saved(group))
        section.notes += [start + sentence for sentence in _risked(table, group.ap)]
        section.tables += [_stages(table, end), _values(group, end).first(MOST_ROWS)]
    return section


def _saved(group: Promoted) -> str:
    spent = savings(group)
    if np.isnan(spent["without"]):
        return "No full training finished, so what promotion saved is not known."
    share = 100 * spent["saved"] / spent["without"]
    verdict = f"{share:.0f} % less" if share >= 0 else f"{-share:.0f} % more"
    return (
        f"Promotion spent {spent['spent']:,.0f} s (surrogates {spent['surrogates']:,.0f}, short "
        f"trainings {spent['short']:,.0f}, full trainings {spent['full']:,.0f}), {verdict} than "
        f"the {spent['without']:,.0f} s that full trainings of all {group.placements:,} placements "
        f"with {group.seeds} seed{'s' * (group.seeds > 1)} would have taken at the mean of those "
        "that were done. Point clouds are counted on neither side."
    )


def _risked(table: pd.DataFrame, ap: pd.Series) -> Iterator[str]:
    if (ap == ap.max()).sum() > 1:
        yield "Several full trainings are equally best, so no rung is rated by its rank of one."
        return
    for row in table[table["n"].notna()].to_dict("records"):
        at_the_end = row["ranked"] > row["kept"] <= row["best_rank"]
        weak = ": as the last of those kept, so a pruned one may well be better"
        yield (
            f"The best of the {len(ap)} trained in full, {ap.idxmax()}, was ranked "
            f"{row['best_rank']:,.0f} of {row['ranked']:,.0f} by {row['stage']}, which kept "
            f"{row['kept']:,}{weak * at_the_end}."
        )


def _stages(table: pd.DataFrame, title: str) -> Table:
    def rank(row: Mapping[Any, Any]) -> str:
        is_known = not np.isnan(row["best_rank"])
        return f"{row['best_rank']:,.0f} of {row['ranked']:,.0f}" if is_known else DASH

    columns = [
        words("stage"),
        numbers("placements", "placements", ","),
        numbers("without a value", "without_value", ","),
        Column("kept", lambda row: f"{row['kept']:,}" if row["kept"] else DASH),
        numbers("seconds", "seconds", _seconds),
        numbers("seconds a placement", "seconds_each", _seconds),
        numbers("n of both", "n", ",.0f"),
        numbers("Spearman ρ", "spearman", signed),
        numbers("p", "spearman_p", ".2g"),
        numbers("Kendall τ", "kendall", signed),
        Column("rank of the best", rank),
        words("first of these", "first", lambda name: DASH if pd.isna(name) else str(name)),
        numbers("AP lost by taking it", "regret", ".2f"),
    ]
    return Table.of(
        f"Stages: cost, and agreement with the full training{title}",
        table,
        columns,
        name=slug("promotion stages", title),
        units=dict.fromkeys(("seconds", "seconds_each"), "s"),
    )


def _values(group: Promoted, title: str) -> Table:
    """List rank and value of every placement at every stage, those that came farthest first."""
    ranks = stage_ranks(group)
    ranks = ranks.sort_values(ranks.columns[::-1].tolist(), kind="stable")
    values = group.rungs.pivot(index="placement", columns="rung", values="value")
    data = values.reindex(columns=sorted(values.columns)).reindex(ranks.index)
    data = data.set_axis(group.stages[:-1], axis="columns").assign(**{group.stages[-1]: group.ap})
    forms = [number] * (len(group.stages) - 1) + [partial(digits, form=".1f")]
    cells = [
        [
            form(value) if np.isnan(rank) else f"{form(value)} ({rank:.0f})"
            for value, rank in zip(data[stage], ranks.iloc[:, i], strict=True)
        ]
        for i, (stage, form) in enumerate(zip(group.stages, forms, strict=True))
    ]
    return Table(
        f"Values by stage, ranks in brackets{title}",
        ("placement", *group.stages),
        tuple(zip(map(str, data.index), *cells, strict=True)),
        name=slug("promotion values", title),
        data=data.rename_axis("placement").reset_index(),
    )


def _seconds(value: float) -> str:
    return digits(value, ",.0f" if abs(value) >= 100 else ".3g")
