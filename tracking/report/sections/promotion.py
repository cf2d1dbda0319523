"""The section about promotion: what it saved and what it risked."""

from __future__ import annotations

import numpy as np
import pandas as pd

from tracking.figures.kit.style import text
from tracking.figures.of_sweeps.promotion import error_over_seconds, ranks_by_stage
from tracking.findings.promotion import FULL_TRAINING, Promoted, promoted, stage_ranks
from tracking.findings.promotion_agreement import agreement
from tracking.findings.promotion_savings import rung_costs, savings
from tracking.numbers import digits, number
from tracking.pages.section import Section
from tracking.pages.tables import MOST_ROWS, Table, slug
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


def _saved(row: dict, seeds: int) -> list[str]:
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
    head = ("stage", "placements", "without a value", "kept", "seconds", "seconds a placement")
    rows = tuple(
        (
            _numbered(i, str(row["stage"])),
            *(f"{row[key]:,}" for key in ("placements", "without_value")),
            "–" if row["stage"] == FULL_TRAINING else f"{row['kept']:,}",
            *(_seconds(row[key]) for key in ("seconds", "seconds_each")),
        )
        for i, row in enumerate(costs.to_dict("records"), start=1)
    )
    data = costs.rename(columns={k: f"{k} (s)" for k in ("seconds", "seconds_each")})
    return Table(f"Stages{title}", head, rows, name=slug("promotion stages", title), data=data)


def _agreement(pairs: pd.DataFrame, title: str) -> Table:
    head = (
        *("earlier stage", "later stage", "n", "Spearman ρ", "p", "Kendall τ", "p"),
        *(
            "best of the later",
            "its rank earlier",
            "first of the earlier",
            "worse than the best by",
        ),
    )
    rows = tuple(
        (
            f"rung {row['rung']}",
            FULL_TRAINING if row["to_full"] else f"rung {row['rung'] + 1}",
            str(row["n"]),
            *(
                digits(row[key], form)
                for name in ("spearman", "kendall")
                for key, form in ((name, "+z.2f"), (f"{name}_p", ".2g"))
            ),
            str(row["best"]),
            f"{row['best_rank']:,} of {row['ranked']:,}",
            str(row["first"]) + (f" (rank {row['first_rank']:,})" if row["first_rank"] > 1 else ""),
            f"{row['regret']:.2f} AP" if row["to_full"] else number(row["regret"]),
        )
        for row in pairs.to_dict("records")
    )
    words = frozenset({0, 1, 7, 8, 9})
    return Table(
        f"Agreement of stages, among placements of both{title}",
        head,
        rows,
        words=words,
        name=slug("promotion agreement", title),
        data=pairs,
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
    columns = ("surrogates", "short", "full", "spent", "without", "saved")
    head = (
        *("group", "placements", "surrogates (s)", "short trainings (s)", "full trainings (s)"),
        *("spent (s)", "all in full, estimated (s)", "saved (s)", "saved (%)"),
    )
    rows = tuple(
        (
            str(row["group"]),
            f"{row['placements']:,}",
            *(_seconds(row[key]) for key in columns),
            _seconds(round(100 * row["saved"] / row["without"], 0)),
        )
        for row in saved.to_dict("records")
    )
    seconds = {key: f"{key} (s)" for key in columns}
    data = saved.rename(columns=seconds)
    return Table("What promotion saved", head, rows, name="promotion-saved", data=data)


def _numbered(number: int, name: str) -> str:
    return name if name == FULL_TRAINING else f"rung {number}: {name}"


def _seconds(value: float) -> str:
    return digits(value, ",.0f" if abs(value) >= 100 else ".3g")
