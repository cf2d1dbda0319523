"""The section of one frame as each placement sees it."""

from __future__ import annotations

from tracking.figures.of_sweeps.point_cloud import point_clouds
from tracking.findings.groups import has_detectors, pictured
from tracking.pages.section import Section
from tracking.run_folders.sweep import RunFolder

MOST_CLOUDS = 12
"""Placements in the menus: a page must stay small."""


def clouds_section(run: RunFolder, ranked: list[str]) -> Section | None:
    """Two views of one frame with menus; None for a sweep without detectors: it has no clouds."""
    if not has_detectors(run):
        return None
    section = Section("One frame, as each placement sees it", columns=2)
    shown = [name for name in ranked if run.frame is not None and name in run.frame.points]
    shown = shown[:MOST_CLOUDS]
    if run.frame is None or not shown:
        section.notes.append("The run folder has no frame.npz.")
        return section
    if pictured(run):
        section.notes.append(f"The frame is {pictured(run)}.")
    section.notes.append(
        "The same objects under two placements, chosen by the menus: at the start the best and the "
        "last of the ranking. A colour is a LiDAR, outlines are the ground truth; at most "
        "8,000 points are drawn."
    )
    for first in dict.fromkeys((shown[0], shown[-1])):
        section.figures.append(
            point_clouds(
                run.frame, run.roi, run.sweep.body, shown, first, colours=run.sweep.colours
            )
        )
    return section
