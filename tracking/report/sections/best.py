"""Comparison of placements: which is best, by how much and how certain."""

from collections.abc import Iterator, Sequence

import numpy as np
import pandas as pd

from tracking.figures.kit.side_by_side import side_by_side
from tracking.figures.kit.style import text
from tracking.findings.best_placement import BestPlacement
from tracking.findings.summary import for_comparison
from tracking.kitti_iou import at_headline_iou
from tracking.labels import DASH, percent, plus_minus, span
from tracking.pages.section import MOST_ROWS, Column, Section, Table, numbers, slug, words
from tracking.report.analysis import Analysis
from tracking.report.headline import class_label, headline_label
from tracking.report.recommendation import Recommendation

_Ranked = tuple[Recommendation, str, BestPlacement]
MOST_DRAWN = 20


def best_section(analysis: Analysis) -> Section | None:
    """Compare placements by what decides in the first group; None without results."""
    return _section("Which placement is best?", analysis, _ranked(analysis)[:1])


def by_class_section(analysis: Analysis) -> Section | None:
    """Compare placements in the other classes and groups."""
    title = "Which placement is best for each class and setting?"
    return _section(title, analysis, _ranked(analysis)[1:])


def _ranked(analysis: Analysis) -> list[_Ranked]:
    """List all groups and classes, of each group the class that decides first."""
    return [
        (recommended, name, recommended.ranking[name])
        for recommended in analysis.recommended
        for name in dict.fromkeys((recommended.by, *recommended.ranking))
    ]


def _section(title: str, analysis: Analysis, ranked: Sequence[_Ranked]) -> Section | None:
    if not ranked:
        return None
    run = analysis.run
    section = Section(title, [*_notes(ranked), *_seed_effects(ranked)])
    for recommended, name, best in ranked:
        group, label = recommended.group, headline_label(run.results, name)
        of_class = at_headline_iou(group.of(analysis.means), run.results, name).set_index(
            "placement"
        )
        table, title = of_class.loc[best.sure.index], group.label(class_label(name))
        sure = best.sure.head(MOST_DRAWN)
        weak = recommended.statements[name].weaknesses
        odds = [] if weak or sure.isna().any() else sure.map(percent).tolist()
        heading, axis = text(title[0].upper() + title[1:]), f"{label} (%)"
        compared = {label: for_comparison(table)}
        plot = side_by_side(compared, sure.index.tolist(), heading, axis, odds)
        section.figures.append(plot.update_traces(showlegend=False))
        section.tables.append(_table(table, best, label, title))
    return section


def _notes(ranked: Sequence[_Ranked]) -> Iterator[str]:
    """Say what the intervals include."""
    more = max(len(best.sure) for *_, best in ranked) - MOST_DRAWN
    drawn = f" The figure has the best {MOST_DRAWN}." if more > 0 else ""
    if all(best.sure.isna().all() for *_, best in ranked):
        yield f"One seed: the spread over seeds is unknown, so there are no intervals.{drawn}"
    elif any(best.sample for *_, best in ranked):
        yield (
            "Means over seeds. Bars are 95 % intervals for a comparison: all placements met the "
            f"same test objects.{drawn}"
        )
        yield (
            "Intervals include the training (spread over seeds, pooled over the placements) and "
            "the test objects (each route and each individual left out in turn, the larger error). "
            "Leads have intervals that hold for all pairs at once, because the best was chosen "
            "from the data; leads in AP are those of the area under precision over recall, which "
            "AP_R40 samples. Other training traffic and other towns are not included."
        )
    else:
        yield f"Means over seeds with 95 % intervals.{drawn}"
        yield (
            "The spread is pooled over the placements. Leads have intervals that hold for all "
            "pairs at once, because the best was chosen from the data. Intervals include only "
            "the randomness of training, on the same scenes and test frames. Other traffic may "
            "rank the placements differently."
        )


def _seed_effects(ranked: Sequence[_Ranked]) -> Iterator[str]:
    """Say how much seeds shift all placements alike, in one sentence."""
    effects = [
        f"{recommended.group.label(class_label(name))} {best.seed_sd:.1f} ({best.sd:.1f})"
        for recommended, name, best in ranked
        if np.isfinite(best.seed_sd)
    ]
    if effects:
        yield (
            "Placements with the same seeds are compared seed by seed. Standard deviation of the "
            "points that a seed adds to all placements alike, which cancel between them, and in "
            f"brackets of those that it adds to one placement: {'; '.join(effects)}."
        )


def _table(table: pd.DataFrame, best: BestPlacement, metric: str, label: str) -> Table:
    """List the best, those not significantly behind it, then the others."""
    leads = best.others[["lead", "low", "high"]].assign(p=best.p)
    leads = leads.rename(columns={"low": "low_of_lead", "high": "high_of_lead"})
    joined = table[["mean", "sd", "sample_sd", "low", "high", "half", "seeds"]].join(leads)
    joined["sure"] = best.sure
    behind = joined["low_of_lead"].gt(0).map({True: "lower", False: "not significant"})
    joined["against"] = behind.mask(joined["low_of_lead"].isna(), DASH)
    joined.loc[best.best, "against"] = "highest mean"
    joined = joined.sort_values("against", key=lambda of: of == "lower", kind="stable")
    columns = [
        words("placement"),
        Column(f"{metric} (%)", lambda row: plus_minus(row["mean"], row["sd"])),
        words("against the best", "against"),
        numbers("below the best (points)", "lead", "z.1f"),
        Column(
            "95 %, all pairs at once",
            lambda row: span(row["low_of_lead"], row["high_of_lead"], "z.1f"),
        ),
        numbers("likely to be the best", "sure", percent),
        numbers("p, adjusted", "p", ".2g"),
        Column("95 % of the mean", lambda row: span(row["low"], row["high"], "z.1f")),
        numbers("sd by test objects", "sample_sd", ".1f"),
        numbers("seeds", "seeds", ".0f"),
    ]
    names = {"p": "p_adjusted", "sure": "probability_best", "sample_sd": "sd_by_test_objects"}
    names |= {"half": "half_interval_compared", "against": "against_the_best"}
    joined = joined.reset_index()
    return Table.of(
        f"{metric} · {label}",
        joined,
        columns,
        name=slug("best", metric, label),
        data=joined.rename(columns=names),
    ).first(MOST_ROWS)
