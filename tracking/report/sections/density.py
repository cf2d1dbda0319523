"""The section of traffic density: AP, recall and surrogates by the number of vehicles."""

from collections.abc import Sequence
from dataclasses import replace

import pandas as pd
import plotly.graph_objects as go

from lidarplace.base.metrics import headline_metric
from tracking.figures.kit.style import text
from tracking.findings.groups import Group
from tracking.findings.paired import with_sums
from tracking.findings.summary import surrogates_of
from tracking.kitti_iou import headline_iou, judged
from tracking.labels import in_order, metric_label, number, plus_minus, points, surrogate_label
from tracking.pages.section import (
    MOST_ROWS,
    PERCENT,
    Section,
    Table,
    numbers,
    slug,
    with_units,
    words,
)
from tracking.report.analysis import Analysis
from tracking.report.headline import class_label
from tracking.report.sections.objects import Bins, by_bin
from tracking.report.sections.published import published_density_table

DENSITY = "scene.density"
SHOWN = ("s_mig", "h_pog", "ig", "expected_ig")
"""The surrogates of the paper's table, and expected IG."""
MOST_LINES = 12


def density_section(found: Analysis) -> Section | None:
    """AP and surrogates against density; None for a sweep with less than two densities."""
    run = found.run
    if DENSITY not in run.axes or run.trials[DENSITY].nunique() < 2:
        return None
    densities = sorted(run.trials[DENSITY].dropna().unique().tolist())
    section = Section("Ablation: density", columns=2)
    section.notes.append(
        "The same placements in sparser and denser traffic. Each density has its own scenes for "
        "training and testing. Bars are 95 % intervals."
    )
    surrogates, order = with_sums(run.surrogates, run.axes), list(run.placements)
    # One density each: the groups of the others differ in density alone.
    alike = [g for g in found.groups if g.setting[DENSITY] == found.groups[0].setting[DENSITY]]
    for name in (*run.classes, "all"):
        metric = headline_metric(name)
        label = metric_label(metric, headline_iou(run.results, name))
        own = judged(found.means, run.results, name)
        heading = class_label(name)
        for group in alike:
            parts = [_at(group, density).of(own) for density in densities]
            rest = replace(group, setting=_rest(group)).title
            title = f"{heading} · {rest}" if len(alike) > 1 else heading
            if any(part["seeds"].gt(0).any() for part in parts):
                together = pd.concat(parts)
                section.figures.append(_figure(together, text(title), f"{label} (%)", order))
                section.tables.append(_metric_table(together, densities, f"{title} · {label} (%)"))
        if DENSITY in surrogates.columns:
            values = {
                f"density {density}": surrogates_of(
                    surrogates, _at(alike[0], density).setting, name
                )
                for density in densities
            }
            section.tables += _surrogate_tables(values, order, heading)
    section.notes.append(
        "The paper published this ablation for one placement, Square, without the number of "
        "vehicles in its dense, medium and sparse traffic."
    )
    section.tables.append(published_density_table())
    return section


def _rest(group: Group) -> dict[str, object]:
    return {axis: value for axis, value in group.setting.items() if axis != DENSITY}


def _at(group: Group, density: object) -> Group:
    return replace(group, setting={**group.setting, DENSITY: density})


def _figure(means: pd.DataFrame, title: str, axis: str, placements: Sequence[str]) -> go.Figure:
    """A line for each of the first `MOST_LINES` placements with a value."""
    names = [str(density) for density in sorted(means[DENSITY].unique())]
    known = set(means.loc[means["seeds"] > 0, "placement"])
    shown = [name for name in placements if name in known][:MOST_LINES]
    drawn = means[means["placement"].isin(shown)].rename(
        columns={"mean": "value", "ground_truths": "objects"}
    )
    bins = Bins("density (vehicles in the town)", tuple(names))
    return by_bin(drawn.assign(bin=drawn[DENSITY].astype(str)), bins, title, axis, placements)


def _metric_table(means: pd.DataFrame, densities: list[object], caption: str) -> Table:
    wide = {
        density: means[means[DENSITY] == density].set_index("placement") for density in densities
    }
    placements = list(dict.fromkeys(means["placement"]))
    rows = []
    for name in placements:
        cells = [table.reindex([name]).iloc[0] for table in wide.values()]
        change = cells[-1]["mean"] - cells[0]["mean"]
        rows.append((name, *(plus_minus(c["mean"], c["sd"]) for c in cells), points(change)))
    head = ("placement", *(f"density {density}" for density in densities), "change (points)")
    columns = ["placement", "detector", DENSITY, "mean", "sd", "low", "high", "seeds"]
    return Table(
        caption,
        head,
        tuple(rows),
        name=slug("density", caption),
        data=with_units(means[columns], PERCENT),
    ).first(MOST_ROWS)


def _surrogate_tables(
    values: dict[str, pd.DataFrame], placements: Sequence[str], heading: str
) -> list[Table]:
    """A row for each placement and each of `SHOWN` that every density has, a column a density."""
    shown = [p for p in placements if any(p in table.index for table in values.values())]
    known = [s for s in SHOWN if all(s in table.columns for table in values.values())]
    if not known:
        return []
    parts = {
        surrogate: pd.DataFrame({head: own[surrogate] for head, own in values.items()}, shown)
        for surrogate in in_order(known)
    }
    table = Table.of(
        f"{heading} · surrogates by density",
        pd.concat(parts, names=["surrogate", "placement"]).reset_index(),
        [
            words("surrogate", show=surrogate_label),
            words("placement"),
            *(numbers(head, head, number) for head in values),
        ],
        name=slug("density surrogates", heading),
        units=dict.fromkeys(values, "nats"),
    )
    return [table.first(MOST_ROWS)]
