"""Place LiDARs on a page of the browser: `lidarplace studio rigs.yaml`."""

import sys
import threading
from pathlib import Path
from typing import Annotated

import typer

from lidarplace.base.errors import InputError
from lidarplace.base.ranges import FRAMES, PORT, RESOLUTION
from lidarplace.base.roi import Roi
from lidarplace.command_line.options import RoiOption, crop_of
from lidarplace.command_line.verbs import checked_input, new_app, verb, within
from lidarplace.logs.box_log import read_box_log
from lidarplace.rigs.scan_timing import STILL_WORLD
from lidarplace.studio.log_frames import scene_of, simulated_traffic, traffic_at
from lidarplace.studio.rigs_file import read_rigs
from lidarplace.studio.studio import PAPER_ROI, Studio

app = new_app()


@verb(app, "examples/studio.yaml", "examples/studio.yaml --log logs/town --frames 1000")
def studio(
    rigs: Annotated[
        Path, typer.Argument(help="YAML file of rigs, or of one placement with `mounts`")
    ],
    log: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="a box log; simulated traffic without one")
    ] = None,
    frames: Annotated[
        int,
        typer.Option(
            help="most frames for the numbers, spread evenly over the log", callback=within(FRAMES)
        ),
    ] = 400,
    roi: RoiOption = (*PAPER_ROI.x, *PAPER_ROI.y, *PAPER_ROI.z),
    resolution: Annotated[
        float, typer.Option(help="edge of a voxel, metres", callback=within(RESOLUTION))
    ] = PAPER_ROI.resolution,
    port: Annotated[
        int | None, typer.Option(help="8080, or the next free one", callback=within(PORT))
    ] = None,
) -> None:
    """Place LiDARs by hand in the browser. The page is on this machine only; Ctrl-C stops it.

    Clouds, blind spots and numbers follow every move. Files are written only on request."""
    import viser  # noqa: F401 - whether it is there is told before anything is read

    from lidarplace.studio.page.page import Page
    from lidarplace.studio.page.server import serving
    from lidarplace.studio.page.tables import left_out_message

    with checked_input():
        x0, y0, z0, x1, y1, z1 = crop_of(roi)
        region = Roi((x0, x1), (y0, y1), (z0, z1), resolution)
        file = read_rigs(rigs)
        if file.site is not None:
            if log is not None:
                fix = f"set scene: {{source: log, folder: {log}}} in {rigs}"
                raise InputError("the file has a site", place="--log", fix=fix)
            traffic = traffic_at(file.scene, file.site, frames)
        else:
            traffic = simulated_traffic() if log is None else read_box_log(log, frames)
        state = Studio(file, traffic, region, folder=log)
        with serving(port, "lidarplace studio") as (server, address):
            page = Page(state, server, scene_of(log, file.scene if file.site else None))
            try:
                if state.left_out:
                    print(left_out_message(state), file=sys.stderr)
                if any(model.timing for rig in file.rigs for model in rig.models(file.lidar)):
                    print(f"warning: {STILL_WORLD}", file=sys.stderr)
                print(f"{address}\nCtrl-C ends it.", flush=True)
                threading.Event().wait()
            finally:
                page.close()
