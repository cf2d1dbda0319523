"""The section of traffic density: AP and recall by the number of vehicles."""

from dataclasses import replace

import pandas as pd

from lidarplace.base.metrics import headline_metric
from tracking.findings.groups import Group
from tracking.kitti_iou import headline_iou, judged
from tracking.labels import metric_label, plus_minus, points
from tracking.pages.section import MOST_ROWS, PERCENT, Section, Table, slug, with_units
from tracking.report.analysis import Analysis
from tracking.report.headline import class_label
from tracking.report.sections.published import published_density_table

DENSITY = "scene.density"


def density_section(found: Analysis) -> Section | None:
    """A column a density; None for a sweep with less than two densities."""
    run = found.run
    if DENSITY not in run.axes or run.trials[DENSITY].nunique() < 2:
        return None
    densities = sorted(run.trials[DENSITY].dropna().unique().tolist())
    section = Section("Ablation: density")
    section.notes.append(
        "The same placements in sparser and denser traffic. Each density has its own scenes for "
        "training and testing."
    )
    # One density each: the groups of the others differ in density alone.
    alike = [g for g in found.groups if g.setting[DENSITY] == found.groups[0].setting[DENSITY]]
    for name in (*run.classes, "all"):
        label = metric_label(headline_metric(name), headline_iou(run.results, name))
        own = judged(found.means, run.results, name)
        for group in alike:
            parts = [_at(group, density).of(own) for density in densities]
            title = f"{class_label(name)} · {label} (%)"
            if len(alike) > 1:
                setting = {axis: v for axis, v in group.setting.items() if axis != DENSITY}
                title = f"{title} · {replace(group, setting=setting).title}"
            if any(part["seeds"].gt(0).any() for part in parts):
                section.tables.append(_metric_table(pd.concat(parts), densities, title))
    section.notes.append(
        "The paper published this ablation for one placement, Square, without the number of "
        "vehicles in its dense, medium and sparse traffic."
    )
    section.tables.append(published_density_table())
    return section


def _at(group: Group, density: object) -> Group:
    return replace(group, setting={**group.setting, DENSITY: density})


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
