"""The section that says which placement is best, by how much and how sure."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from lidarplace.base.metrics import headline_metric
from tracking.figures.kit.named_points import placement_markers
from tracking.figures.kit.style import OUTLINE, add_odds, error_bars, figure, name_rows, text
from tracking.findings.best_placement import BestPlacement
from tracking.findings.groups import Group
from tracking.kitti_iou import headline_iou, judged
from tracking.labels import metric_label, percent, plus_minus, span
from tracking.pages.section import MOST_ROWS, Column, Section, Table, numbers, slug, words
from tracking.report.analysis import Analysis
from tracking.report.headline import class_label

MOST_DRAWN = 20
_ROW = 26  # pixels


def best_section(found: Analysis) -> Section | None:
    """A figure and a table of every group and class; None without results."""
    run, rankings = found.run, found.rankings
    if not any(ranked for _, ranked in rankings):
        return None
    samples = [best.sample for _, ranked in rankings for best in ranked.values()]
    notes = [*_notes(any(samples)), *_seed_effects(rankings)]
    section = Section("Which placement is best?", notes)
    for group, ranked in rankings:
        for name, best in ranked.items():
            metric, iou = headline_metric(name), headline_iou(run.results, name)
            own = judged(group.of(found.means), run.results, name)
            table = own.set_index("placement").loc[best.sure.index]
            label = group.label(class_label(name))
            section.figures.append(
                forest(
                    table.head(MOST_DRAWN).assign(
                        sure=[_share(sure) for sure in best.sure.head(MOST_DRAWN)]
                    ),
                    text(label[0].upper() + label[1:]),
                    f"{metric_label(metric, iou)} (%)",
                    list(run.placements),
                )
            )
            section.tables.append(_table(table, best, metric_label(metric, iou), label))
    return section


def _notes(sampled: bool) -> list[str]:
    """What the intervals hold."""
    if not sampled:
        return [
            "Means over seeds with 95 % intervals, whose spread is pooled over the placements. "
            "Leads of the best have intervals that hold for all pairs at once, because the best "
            "was chosen from the data. All of this is about the chance of training: the same "
            "scenes, and the same test frames. Other traffic may rank them otherwise."
        ]
    return [
        "Means over seeds. Intervals are 95 % and include two sources of chance: the training "
        "(spread over seeds, pooled over the placements), and the test objects (each route and "
        "each individual left out in turn, the larger error). Thin bars are for the mean "
        "itself. All placements met the same objects, so thick bars, leads and probabilities "
        "are for a comparison. Leads have intervals that hold for all pairs at once, because "
        "the best was chosen from the data; leads in AP are those of the area under precision "
        "over recall, which AP_R40 samples. Other training traffic and other towns are in none "
        "of this."
    ]


def _seed_effects(rankings: Sequence[tuple[Group, Mapping[str, BestPlacement]]]) -> Iterator[str]:
    """How much seeds shift all placements alike, one sentence for all that can say so."""
    effects = [
        f"{group.label(class_label(name))} {best.seed_sd:.1f} ({best.sd:.1f})"
        for group, ranked in rankings
        for name, best in ranked.items()
        if np.isfinite(best.seed_sd)
    ]
    if effects:
        yield (
            "Placements with the same seeds are compared seed by seed. Standard deviation of the "
            "points that a seed adds to all placements alike, which cancel between them, and in "
            f"brackets of those that it adds to one placement: {'; '.join(effects)}."
        )


def _share(sure: float) -> str:
    return "–" if np.isnan(sure) else percent(sure)


def _table(table: pd.DataFrame, best: BestPlacement, metric: str, label: str) -> Table:
    leads = best.others[["lead", "low", "high", "p"]]
    leads = leads.rename(columns={"low": "low_of_lead", "high": "high_of_lead"})
    joined = table[["mean", "sd", "sample_sd", "low", "high", "half", "seeds"]].join(leads)
    joined["sure"] = best.sure
    columns = [
        words("placement"),
        Column(f"{metric} (%)", lambda row: plus_minus(row["mean"], row["sd"])),
        numbers("sd by test objects", "sample_sd", ".1f"),
        Column("95 %", lambda row: span(row["low"], row["high"], "z.1f")),
        numbers("seeds", "seeds", ".0f"),
        numbers("below the best (points)", "lead", "z.1f"),
        Column(
            "95 %, all pairs at once",
            lambda row: span(row["low_of_lead"], row["high_of_lead"], "z.1f"),
        ),
        numbers("p, adjusted", "p", ".2g"),
        numbers("likely to be the best", "sure", _share),
    ]
    names = {"p": "p_adjusted", "sure": "probability_best", "sample_sd": "sd_by_test_objects"}
    names["half"] = "half_interval_compared"
    joined = joined.reset_index()
    return Table.of(
        f"{metric} · {label}",
        joined,
        columns,
        name=slug("best", metric, label),
        data=joined.rename(columns=names),
    ).first(MOST_ROWS)


def forest(table: pd.DataFrame, title: str, axis: str, placements: Sequence[str]) -> go.Figure:
    """A row a placement: mean, interval, and on the right how sure it is that it is the best.

    Args:
        table: index placement, the best first; `mean`; `low` and `high` of it, and `half` the
            interval of a comparison, missing where there is none; and `sure`, text.
        axis: what the mean is of, with its unit.
    """
    names = [str(name) for name in table.index]
    plot = figure(title, height=130 + _ROW * len(names))
    rows = list(range(len(names)))
    mean, half = table["mean"], table["half"].fillna(0)
    # No percentage is beyond 0 and 100, whatever a symmetric interval says.
    up, down = half.clip(upper=100 - mean), half.clip(upper=mean)
    above, below = (table["high"].clip(upper=100) - mean), mean - table["low"].clip(lower=0)
    if (above > up).any() or (below > down).any():
        plot.add_scatter(
            x=mean.to_numpy(),
            y=rows,
            error_x=error_bars(above, below, thickness=1, width=0, color=OUTLINE),
            mode="markers",
            marker={"size": 1, "color": OUTLINE},
            hoverinfo="skip",
            showlegend=False,
        )
    plot.add_scatter(
        x=mean.to_numpy(),
        y=rows,
        error_x=error_bars(up, down, thickness=3, width=4, color=OUTLINE),
        mode="markers",
        marker=placement_markers(names, placements),
        text=[text(name) for name in names],
        hovertemplate="%{text}<br>%{x:.2f} %<extra></extra>",
        showlegend=False,
    )
    plot.update_xaxes(title=axis)
    name_rows(plot, names, showgrid=False)
    add_odds(plot, list(table["sure"]))
    return plot
