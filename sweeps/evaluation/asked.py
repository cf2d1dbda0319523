"""What options of a command ask for: a log, its test frames, and what rigs found in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

from lidarplace.base.errors import InputError
from lidarplace.base.roi import Roi
from lidarplace.command_line.verbs import crop_of, known
from lidarplace.detections.read import LAYOUTS
from lidarplace.logs.box_log import BoxLog, read_box_log
from lidarplace.logs.boxes import SPLITS
from lidarplace.scenes.datasets.class_maps import named_class_map
from sweeps.evaluation.rigs import FoundBy, How, by_rig, read_rigs
from sweeps.evaluation.test_frames import Counted, TestFrames

ALONE = "detections"
"""Name of a rig that got none."""


@dataclass(frozen=True)
class Asked:
    """What was read.

    Attributes:
        whole: the log.
        test: its frames that are judged.
        rigs: what was found in them.
        paths: of the files, by rig.
        settings: plain data of everything else.
        notes: what counts, a sentence each.
        cautions: what may be wrong with the detections, a sentence each.
    """

    whole: BoxLog
    test: TestFrames
    rigs: list[FoundBy]
    paths: dict[str, list[str]]
    settings: dict[str, object]
    notes: list[str]
    cautions: list[str]


def asked_for(
    log: Path,
    detections: Sequence[Path],
    rigs: Sequence[str],
    layout: str | None,
    world: bool,
    calib: Path | None,
    class_map: str,
    roi: Sequence[float],
    classes: Sequence[str],
    split: str,
    counted: str,
) -> Asked:
    """Read what the options of `sweeps.options` name.

    Raises:
        OSError: a file cannot be read.
        ValueError: an option or a file is wrong.
    """
    if bool(detections) == bool(rigs):
        problem = "both, or none" if detections else "no detections"
        expected = "DETECTIONS of one rig, or --rig NAME=PATH for each of several"
        raise InputError(problem, place="DETECTIONS, --rig", expected=expected)
    paths = by_rig(rigs) or {ALONE: [str(path) for path in detections]}
    files = {name: [[Path(own)] for own in each] for name, each in paths.items()}
    if detections:
        files = {ALONE: [[*detections]]}
    crop = crop_of(roi)
    Roi(tuple(roi[:2]), tuple(roi[2:4]), tuple(roi[4:]), 0.1)  # type: ignore[arg-type]
    how = How(
        None if layout is None else known("layout", layout, {name: name for name in LAYOUTS}),
        world,
        calib,
        named_class_map(class_map),
    )
    rule = known("counted", counted, {str(name): name for name in get_args(Counted)})
    whole = read_box_log(log)
    test = TestFrames.of(
        whole, known("split", split, dict(zip(SPLITS, SPLITS, strict=True))), crop, classes, rule
    )
    read = read_rigs(files, whole, test, how)
    notes = [test.said, *(said for rig in read for said in rig.said)]
    if how.calibration is None and any(
        rig.placement.name == "kitti" for rig in whole.rigs.values()
    ):
        notes.append("KITTI's result files are read with the camera of `lidarplace export`.")
    settings: dict[str, object] = {
        "log": str(log),
        "classes": list(test.classes),
        "roi": list(map(float, roi)),
        "split": split,
        "counted": counted,
        "class_map": class_map,
        "notes": notes,
    }
    cautions = [said for rig in read for said in rig.cautions]
    return Asked(whole, test, read, paths, settings, notes, cautions)
