"""Export of a box log and its point clouds for other tools: `lidarplace export LOG OUT`."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
import typer

from lidarplace.base.errors import InputError
from lidarplace.base.ranges import SEED
from lidarplace.clouds.clouds import Crop, PointClouds
from lidarplace.clouds.collect import collect, crop_for
from lidarplace.clouds.profiles import PROFILES
from lidarplace.clouds.recorded import check_rig, recorded_clouds
from lidarplace.clouds.visibility import ground_truth
from lidarplace.command_line.options import (
    FRONT_ROI,
    LogArgument,
    ProfileOption,
    RoiOption,
    crop_of,
)
from lidarplace.command_line.terminal import Terminal, say
from lidarplace.command_line.verbs import checked_input, known, new_app, verb, within
from lidarplace.configuration.placement import named_placement
from lidarplace.logs.box_log import BoxLog, read_box_log
from lidarplace.logs.boxes import SPLITS
from lidarplace.rigs.placement import PAPER_PLACEMENTS
from lidarplace.scenes.kitti.labels import in_image, to_labels
from lidarplace.scenes.kitti.write import check_new, write_kitti
from lidarplace.viewing.frame import centres_in

PORTION = 100
"""Frames whose clouds are in memory at a time."""

app = new_app()


@verb(app, "logs/town kitti/line --placement line --images", "logs/town line.mcap --placement line")
def export(
    log: LogArgument,
    out: Annotated[Path, typer.Argument(help="folder to write, new or empty; or FILE.mcap")],
    placement: Annotated[
        str,
        typer.Option(
            metavar="NAME|FILE",
            help="one of the paper's, or FILE.yaml with `mounts`",
            autocompletion=lambda: list(PAPER_PLACEMENTS),
        ),
    ],
    profile: ProfileOption = "paper",
    roi: RoiOption = FRONT_ROI,
    split: Annotated[
        str | None,
        typer.Option(
            metavar="train|test", help="both by default", autocompletion=lambda: list(SPLITS)
        ),
    ] = None,
    all_around: Annotated[
        bool, typer.Option("--all-around", help="label objects outside the image too")
    ] = False,
    images: Annotated[
        bool,
        typer.Option("--images", help="write black images, for tools that read the image size"),
    ] = False,
    seed: Annotated[
        int, typer.Option(help="seed of shapes, drop-off and range noise", callback=within(SEED))
    ] = 0,
    recorded: Annotated[
        bool,
        typer.Option(
            "--recorded", help="use the clouds in LOG/clouds/PLACEMENT instead of simulating"
        ),
    ] = False,
) -> None:
    """Write KITTI's object layout, as OpenPCDet reads it, or FILE.mcap.

    An MCAP file is a recording that Foxglove plays: clouds, boxes, mounts."""
    counts: Counter[str] = Counter()
    played = out.suffix == ".mcap"
    with checked_input():
        if not played:
            check_new(out)
        elif all_around or images:
            wrong = "apply to KITTI's layout only, not to FILE.mcap"
            raise InputError(wrong, place="--all-around and --images")
        crop = crop_of(roi)
        conditions = known("profile", profile, PROFILES)
        rig = conditions.placement(named_placement(placement, conditions.lidar))
        chosen = _frames_of(read_box_log(log), split, log)
        misaligned = conditions.misaligned_heights
        cloud_crop = crop_for(crop[::3], crop[1::3], crop[2::3], rig, misaligned)
        if recorded:
            check_rig(log / "clouds" / rig.name, rig)

        def portion(part: BoxLog) -> tuple[pd.DataFrame, PointClouds]:
            numbers = part.frames["frame"].to_numpy(np.int64)
            if recorded:
                clouds = recorded_clouds(log / "clouds" / rig.name, numbers, cloud_crop)
            else:
                clouds = collect(part, numbers, rig, cloud_crop, seed, misaligned)
            counts["points"] += int(clouds.counts.sum())
            boxes = part.boxes[centres_in(crop, part.boxes)]
            counts["boxes"] += len(boxes)
            return boxes if played else _labels(part, crop, seed, all_around, counts), clouds

        portions = map(portion, _some_at_a_time(chosen))
        if played:
            from lidarplace.viewing.mcap import write_mcap  # foxglove

            write_mcap(out, chosen.frames, portions, rig)
        else:
            write_kitti(out, chosen.frames, portions, images)
    kind, frames = "boxes" if played else "labels", len(chosen.frames)
    say(f"{out}: {frames:,} frames, {counts[kind]:,} {kind}, {counts['points']:,} points")
    if not played:
        outside = "labelled all the same" if all_around else "left out (--all-around labels them)"
        hidden = counts["boxes"] - counts["seen"]
        say(
            f"  {hidden:,} objects of the ROI left out: an ideal sensor would not see "
            f"them\n  {counts['outside']:,} objects outside the image {outside}"
        )


def _frames_of(log: BoxLog, split: str | None, folder: Path) -> BoxLog:
    frames = log.frames if split is None else log.frames[log.frames["split"] == split]
    if frames.empty:
        splits = ", ".join(sorted(set(log.frames["split"]))) or "no frame"
        problem = f"no frame of split {split or 'train or test'}"
        raise InputError(problem, place=folder, found=splits)
    return replace(log, frames=frames)


def _some_at_a_time(log: BoxLog) -> Iterator[BoxLog]:
    from rich.progress import track

    starts, console = range(0, len(log.frames), PORTION), Terminal(stderr=True)
    for first in track(starts, "frames", console=console, disable=not console.is_terminal):
        frames = log.frames.iloc[first : first + PORTION]
        boxes = log.boxes[log.boxes["frame"].isin(frames["frame"])]
        yield replace(log, boxes=boxes, frames=frames)


def _labels(
    log: BoxLog, roi: Crop, seed: int, all_around: bool, counts: Counter[str]
) -> pd.DataFrame:
    """Label the objects of a log; count them and those without."""
    x0, y0, z0, x1, y1, z1 = roi
    labels = to_labels(ground_truth(log, (x0, x1), (y0, y1), (z0, z1), seed))
    visible = in_image(labels)
    counts["seen"] += len(labels)
    counts["outside"] += int((~visible).sum())
    labels = labels if all_around else labels[visible]
    counts["labels"] += len(labels)
    return labels
