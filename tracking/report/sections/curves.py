"""The section of learning curves."""

from __future__ import annotations

from tracking.figures.kit.style import text
from tracking.figures.of_sweeps.learning_curves import learning_curves
from tracking.findings.groups import Group, has_detectors
from tracking.pages.section import Section
from tracking.run_folders.sweep import RunFolder


def curves_section(run: RunFolder, found: list[Group]) -> Section | None:
    """A figure a group and metric of training; None for a sweep without detectors."""
    if not has_detectors(run):
        return None
    section = Section("Learning curves")
    if run.curves is None or run.curves.empty:
        section.notes.append("The run folder has no curves.parquet.")
        return section
    section.notes.append("One line a trial; lines of one colour differ by seed.")
    for group in found:
        for metric in dict.fromkeys(run.curves["metric"]):
            plot = learning_curves(
                run.curves, group.of(run.trials), metric, text(group.title), list(run.placements)
            )
            section.figures.append(plot)
    section.columns = min(2, len(section.figures))
    return section
