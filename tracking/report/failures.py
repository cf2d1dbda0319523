"""Build the page of what one rig finds and another one misses, with frames to look at."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import plotly.graph_objects as go

from lidarplace.base.roi import Roi
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.mounting.vehicle import Vehicle
from tracking.figures.kit.vehicle_in_space import vehicle_in_space
from tracking.figures.of_sweeps.frame_in_space import (
    DETECTION,
    FOUND,
    frame_in_space,
    view_around,
    view_of,
)
from tracking.findings.best_placement import BestPlacement
from tracking.findings.failures import Failures, failures
from tracking.findings.groups import Group
from tracking.numbers import digits
from tracking.pages.page import figure_json, write_page
from tracking.pages.section import Section
from tracking.report.decision.recommendation import recommendations, recommended
from tracking.run_folders.sweep import RunFolder
from tracking.run_folders.sweep_arrays import FailureFrames

FILE = "failures.html"


@dataclass(frozen=True)
class _Shown:
    """A frame to click at.

    Attributes:
        rig: place of the one that found more in it.
        what, fate: the object that it is shown for, and what became of it.
        where: scene, route and frame.
        figures: under each rig, as JSON.
        view: plotly's scene around the object, as JSON.
    """

    rig: int
    what: str
    fate: str
    where: str
    figures: tuple[str, str]
    view: str


def compared_failures(
    run: RunFolder, rankings: Iterable[tuple[Group, Mapping[str, BestPlacement]]]
) -> Failures | None:
    """What the recommended rig and the next one behind it found, where both is known.

    Args:
        run: distinct rigs, trained as long as they get.
        rankings: groups with their `headline_ranking`.
    """
    for group, ranked in rankings:
        for found in recommendations([(group, ranked)]):
            return failures(run, group, found.compared) if found.compared else None
    return None


def failures_to_show(folder: Path) -> Failures | None:
    """The `compared_failures` of a run folder. Raises as `RunFolder.read`."""
    run, found = recommended(RunFolder.read(folder))
    return compared_failures(run, ((own.group, own.ranked) for own in found))


def write_failures(
    target: Path,
    found: Failures,
    frames: FailureFrames | None,
    section: Section,
    roi: Roi,
    vehicle: Vehicle | None,
    extent: str,
    links: Mapping[str, str],
) -> Path:
    """Write the page to `target`.

    Args:
        frames: of the same two rigs; None where there are none to show.
        section: `tracking.report.sections.failures.failures_section`, whose tables are written.
        vehicle: carries them; None for a sedan.
        extent: how much was compared, in one line.
        links: to other pages, by address.
    """
    first, second = found.rigs
    return write_page(
        target,
        Path(__file__).with_name("failures.html"),
        [Section("Counted", section.notes[2:], section.figures, section.tables, columns=2)],
        name=f"{first} and {second}",
        rigs=found.rigs,
        extent=extent,
        links=links,
        said=section.notes[:2],
        frames=_shown(found, frames) if frames is not None else [],
        colours={**FOUND, f"detected with seed {found.seeds[0]}": DETECTION},
        whole=json.dumps(view_of(roi, vehicle)),
        vehicle=figure_json(go.Figure(vehicle_in_space(vehicle), layout={"template": None})),
    )


def _shown(found: Failures, frames: FailureFrames) -> list[_Shown]:
    number = {int(own): row for row, own in enumerate(found.objects["object"])}
    shown = []
    for place, own in enumerate(frames.objects.tolist()):
        row = number[own]
        at = found.objects.iloc[row]
        here = np.flatnonzero(found.objects["frame"] == at["frame"])
        figures = [
            frame_in_space(
                found.objects.iloc[here].assign(points=found.points[rig, here]),
                found.shares[rig, here],
                frames.points[f"{place}/{rig}"],
                frames.detections[f"{place}/{rig}"],
            )
            for rig in range(2)
        ]
        box = at[list(GEOMETRY)].to_numpy(np.float64)
        shown.append(
            _Shown(
                rig=int(found.shares[1, row] > found.shares[0, row]),
                what=f"{at['class']}, {np.hypot(at['x'], at['y']):.0f} m",
                fate=_fate(found, row),
                where=f"{at['scene']}, route {at['route']}, frame {at['frame']}",
                figures=(figure_json(figures[0]), figure_json(figures[1])),
                view=json.dumps(view_around(box)),
            )
        )
    return shown


def _fate(found: Failures, row: int) -> str:
    """How many seeds found an object under each rig, and the points on it."""
    seeds = len(found.seeds)
    return "; ".join(
        f"{rig}: {round(share * seeds)} of {seeds}, {digits(count, ',')} points"
        for rig, share, count in zip(
            found.rigs, found.shares[:, row], found.points[:, row], strict=True
        )
    )
