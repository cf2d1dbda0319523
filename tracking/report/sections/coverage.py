"""The section of rigs and maps: where the LiDARs are, what they cover, what stays unseen."""

from __future__ import annotations

from lidarplace.mounting.vehicle import Vehicle
from tracking.figures.kit.from_above import add_vehicle, pog_from_above
from tracking.figures.kit.rig_picture import PicturedRig, rig_picture
from tracking.figures.kit.style import text
from tracking.figures.kit.vehicle_lines import name_of
from tracking.figures.of_sweeps.coverage_maps import SeenFrom, coverage_maps, densest
from tracking.findings.groups import pictured
from tracking.pages.section import Section
from tracking.run_folders.sweep import RunFolder
from tracking.run_folders.sweep_arrays import Maps

MOST_MAPS = 12
"""Placements drawn in maps: a page must stay small."""


def rigs_section(run: RunFolder, ranked: list[str]) -> Section:
    """An interactive picture of the rigs, and where the objects are that they should see."""
    section = Section("Rigs and traffic", columns=2)
    shown = [name for name in ranked if name in run.placements][:MOST_MAPS]
    section.notes.append(
        f"Left: the LiDARs of one placement on {name_of(run.sweep.body)}; the menu chooses the "
        "placement. "
        "POG: entropy of each column of voxels, where objects may or may not be."
    )
    section.notes += _setting(run)
    section.figures.append(
        rig_picture(
            {name: PicturedRig.of(run.placements[name]) for name in shown},
            run.sweep.body or Vehicle.car(),
        )
    )
    for name, entropy in (run.maps.pog if run.maps else {}).items():
        plot = pog_from_above(entropy, run.roi, f"POG · {text(name)}")
        add_vehicle(plot, run.sweep.body, run.roi)
        section.figures.append(plot)
    return section


def coverage_section(run: RunFolder, ranked: list[str]) -> Section:
    """Four maps of every placement, the best first."""
    section = Section("Coverage and residual entropy", columns=2)
    if run.maps is None or not run.maps.residual:
        section.notes.append("The run folder has no maps of residual entropy.")
        return section
    section.notes.append(
        "Left: share of each column of voxels that some beam meets. Right: entropy of all classes "
        "where no beam comes, which is what a placement leaves unseen; one scale for all "
        "placements. Above: from above. Below: from the side, heights stretched. LiDARs and "
        f"{name_of(run.sweep.body)} in orange. Coverage knows no occlusion: a covered voxel may "
        "still be hidden behind an object."
    )
    section.notes += _setting(run)
    shown = [name for name in ranked if name in run.maps.residual][:MOST_MAPS]
    most = (
        densest([run.maps.residual[name] for name in shown], run.roi, run.roi.y),
        densest([run.maps.residual_side[name] for name in shown], run.roi, run.roi.z),
    )
    for name in shown:
        above, side = _seen(run.maps, name)
        body, mounts = run.sweep.body, run.placements[name]
        section.figures.append(coverage_maps(above, side, run.roi, body, text(name), mounts, most))
    if len(shown) < len(run.placements):
        section.notes.append(f"{len(shown)} of {len(run.placements):,} placements are drawn.")
    return section


def _setting(run: RunFolder) -> list[str]:
    return [f"Maps are {pictured(run)}; other settings have their own."] if pictured(run) else []


def _seen(maps: Maps, name: str) -> tuple[SeenFrom, SeenFrom]:
    return (
        SeenFrom(maps.coverage[name], maps.residual[name]),
        SeenFrom(maps.coverage_side[name], maps.residual_side[name]),
    )
