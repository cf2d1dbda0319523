"""Rigs and maps: where the LiDARs are, what they cover, what stays unseen."""

from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from tracking.figures.kit.rig_picture import PicturedRig, rig_picture
from tracking.figures.kit.style import text
from tracking.figures.kit.vehicle_lines import (
    add_vehicle,
    carried_by,
    pog_from_above,
    words_of_maps,
)
from tracking.findings.groups import pictured
from tracking.pages.section import Section
from tracking.report.analysis import Analysis
from tracking.run_folders.sweep import RunFolder

MOST_MAPS = 12  # placements drawn in maps: a page must stay small
_CELLS = 80  # cells along the longer side of a map; a page holds two for every placement
_MARK = "#D55E00"


def rigs_section(analysis: Analysis) -> Section:
    """Draw the rigs in an interactive picture, and where the objects are that they should see."""
    run = analysis.run
    placements = [name for name in analysis.order if run.placements.get(name)][:MOST_MAPS]
    if not placements:
        unknown = "Where the LiDARs are is not known: evaluate --geometry names it."
        return Section("Rigs and traffic", [unknown], columns=2)
    note = (
        f"Left: the LiDARs of one placement {carried_by(run.sweep.body)}; the menu chooses the "
        "placement. POG: entropy of each column of voxels, where objects may or may not be."
    )
    rigs = {name: PicturedRig.of(run.placements[name]) for name in placements}
    section = Section("Rigs and traffic", [note, *_setting(run)], columns=2)
    section.figures.append(rig_picture(rigs, run.sweep.body))
    for name, entropy in (run.maps.pog if run.maps else {}).items():
        plot = pog_from_above(entropy, run.roi, f"POG · {text(name)}")
        section.figures.append(add_vehicle(plot, run.sweep.body, run.roi))
    return section


def coverage_section(analysis: Analysis) -> Section:
    """Draw two maps of every placement, the best first."""
    run = analysis.run
    title = "Coverage and residual entropy"
    if run.maps is None or not run.maps.residual:
        return Section(title, ["The run folder has no maps of residual entropy."])
    note = (
        "From above. Left: share of each column of voxels that some beam meets. Right: entropy of "
        "all classes where no beam comes, which is what a placement leaves unseen; one scale for "
        f"all placements. {words_of_maps(run.sweep.body)} Coverage knows no "
        "occlusion: a covered voxel may still be hidden behind an object."
    )
    section = Section(title, [note, *_setting(run)], columns=2)
    placements = [name for name in analysis.order if name in run.maps.residual][:MOST_MAPS]
    for name in placements:
        label, residual = text(name), run.maps.residual[name] / np.float32(run.roi.resolution**2)
        share = 100 * run.maps.coverage[name]
        section.figures.append(_map(run, name, share, f"{label} · covered", "%"))
        section.figures.append(_map(run, name, residual, f"{label} · residual entropy", "nats/m²"))
    residuals = [plot.data[0] for plot in section.figures[1::2]]
    most = max(heat.zmax for heat in residuals)
    for heat in residuals:
        heat.zmax = most
    if len(placements) < len(run.placements):
        section.notes.append(f"{len(placements)} of {len(run.placements):,} placements are drawn.")
    return section


def _setting(run: RunFolder) -> list[str]:
    return [f"Maps are {pictured(run)}; other settings have their own."] if pictured(run) else []


def _map(run: RunFolder, name: str, cells: NDArray[Any], title: str, unit: str) -> go.Figure:
    plot = pog_from_above(cells, run.roi, title, _CELLS, unit)
    if unit == "%":
        plot.data[0].zmax = 100
    add_vehicle(plot, run.sweep.body, run.roi)
    mounts = run.placements[name]
    return plot.add_scatter(
        x=[mount.x for mount in mounts],
        y=[mount.y for mount in mounts],
        mode="markers",
        marker={"size": 5, "color": _MARK, "line": {"color": "#ffffff", "width": 1}},
        hovertemplate="LiDAR at %{x:.2f}, %{y:.2f} m<extra></extra>",
        showlegend=False,
    )
