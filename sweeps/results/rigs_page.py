"""The rigs of a sweep drawn on the vehicle, before anything is run."""

from pathlib import Path

from sweeps.configuration.grid import Sweep
from sweeps.results.lidar_models import lidar_models
from tracking.figures.kit.vehicle_lines import name_of
from tracking.pages.page import SECTIONS_ALONE, write_page
from tracking.pages.section import Section
from tracking.report.decision.rigs import rig_views, viewed_rig

MOST_DRAWN = 40
"""Rigs; a page of more is not looked at."""


def write_rigs_page(sweep: Sweep, cautions: list[str]) -> Path:
    """Draw the first `MOST_DRAWN` rigs from above and from the side, below what is to be known of
    them. Returns the page, which is in the sweep's run folder."""
    rigs = {own.point.placement: own.rig for own in sweep.points}
    models = lidar_models(sweep)
    drawn = list(rigs)[:MOST_DRAWN]
    vehicle = sweep.points[0].point.body()
    section = Section(
        "Rigs",
        notes=[
            f"The nose of {name_of(vehicle)} is on the right. A line leads from above to where a "
            "LiDAR's top leans, from the side to where its front points. x is forward, y to the "
            "left, z above the ground.",
            *cautions,
        ],
        figures=rig_views(
            [viewed_rig(name, rigs[name].mounts, models.get(name, ())) for name in drawn], vehicle
        ),
    )
    if len(drawn) < len(rigs):
        section.notes.insert(1, f"The first {len(drawn)} of {len(rigs)}.")
    folder = sweep.common.output / sweep.common.name
    folder.mkdir(parents=True, exist_ok=True)
    return write_page(folder / "rigs.html", SECTIONS_ALONE, [section], name=sweep.common.name)
