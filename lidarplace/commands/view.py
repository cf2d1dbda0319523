"""Picture of a frame of a box log: `lidarplace view LOG`."""

from pathlib import Path
from typing import Annotated

import typer

from lidarplace.base.errors import InputError, at
from lidarplace.base.ranges import FRAME
from lidarplace.clouds.clouds import Crop
from lidarplace.clouds.profiles import PROFILES
from lidarplace.command_line.options import (
    FRONT_ROI,
    LogArgument,
    ProfileOption,
    RoiOption,
    crop_of,
)
from lidarplace.command_line.terminal import say
from lidarplace.command_line.verbs import checked_input, known, new_app, verb, within
from lidarplace.configuration.placement import named_placement
from lidarplace.logs.box_log import read_box_log
from lidarplace.rigs.placement import PAPER_PLACEMENTS
from lidarplace.viewing.frame import Frame, busiest_frame, read_frame
from lidarplace.viewing.page import write_page
from lidarplace.viewing.scene import POINTS, draw_frame

DEFAULT = ("line", "center", "pyramid", "line_roll")
"""Placements that are shown when none is named."""
MOST_PLACEMENTS = 12
"""Browsers keep about 16 3D scenes alive; the next one blanks the first."""

app = new_app()


@verb(app, "logs/town --placement line --placement center")
def view(
    log: LogArgument,
    frame: Annotated[
        int | None,
        typer.Option(
            help="the one with most objects in the ROI by default", callback=within(FRAME)
        ),
    ] = None,
    placement: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME|FILE",
            help="one of the paper's, or FILE.yaml with `mounts`; repeatable",
            autocompletion=lambda: list(PAPER_PLACEMENTS),
        ),
    ] = None,
    profile: ProfileOption = "paper",
    roi: RoiOption = FRONT_ROI,
    out: Annotated[Path, typer.Option(metavar="FILE", help="the page")] = Path("view.html"),
) -> None:
    """Make a page of one frame: clouds, boxes, buildings and the ROI, placements side by side."""
    with checked_input():
        crop = crop_of(roi)
        conditions = known("profile", profile, PROFILES)
        names = placement or DEFAULT
        if len(names) > MOST_PLACEMENTS:
            most = f"at most {MOST_PLACEMENTS} on a page"
            raise InputError(place="--placement", expected=most, found=len(names))
        rigs = [conditions.placement(named_placement(name, conditions.lidar)) for name in names]
        box_log = read_box_log(log)
        with at(log):
            number = busiest_frame(box_log, crop) if frame is None else frame
            surroundings = read_frame(box_log, number, crop)
        points, misaligned = POINTS // len(rigs), conditions.misaligned_heights
        figures = [draw_frame(box_log, number, rig, crop, points, misaligned) for rig in rigs]
        title = f"{surroundings.row['scene']}, frame {number}"
        write_page(out, title, _notes(surroundings, crop, profile), figures)
    say(f"{out}: frame {number}, {surroundings.inside.sum()} objects in the ROI")


def _notes(frame: Frame, crop: Crop, profile: str) -> list[str]:
    counts = frame.objects.loc[frame.inside, "class"].value_counts().sort_index()
    objects = ", ".join(f"{name} {count}" for name, count in counts.items()) or "none"
    x0, y0, z0, x1, y1, z1 = crop
    roi = f"x {x0:g} to {x1:g}, y {y0:g} to {y1:g}, z {z0:g} to {z1:g} m".replace("-", "−")
    return [
        f"Route {frame.row['route']} ({frame.row['split']}), t = {frame.row['timestamp_s']:g} s; "
        f"LiDARs of profile {profile}. ROI {roi}. Objects with their centre in it: {objects}.",
        "x is forward, y left, in metres. Points have the colour of their LiDAR, boxes that of "
        "their class and a line towards the front; of many points a random part is drawn. "
        "Drag to rotate all scenes, scroll to zoom, hover over fronts and LiDARs for details.",
    ]
