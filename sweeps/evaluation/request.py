"""What options of a command ask for: test frames of a log, and what rigs found in them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import pandas as pd

from lidarplace.base.class_names import listed
from lidarplace.base.errors import InputError
from lidarplace.clouds.profiles import PROFILES
from lidarplace.command_line.options import crop_of
from lidarplace.command_line.verbs import known
from lidarplace.configuration.placement import read_placement
from lidarplace.detections.read import LAYOUTS, read_detections
from lidarplace.logs.box_log import read_box_log
from lidarplace.logs.boxes import SPLITS
from lidarplace.logs.plausibility import DetectionCheck
from lidarplace.rigs.placement import Placement
from lidarplace.rigs.recorded import one_rig
from lidarplace.scenes.datasets.class_maps import named_class_map
from sweeps.evaluation.test_frames import Counted, TestFrames
from training.sanity_checks.check import check_detections

ALONE = "detections"
"""Name of a rig that got none."""


@dataclass(frozen=True)
class EvaluationRequest:
    """What was read.

    Attributes:
        rigs: detections that are right or wrong about these, by rig and by training.
        paths: of the files, by rig.
        geometry: where the LiDARs are, of rigs of which that is known.
        notes: what counts, a sentence each.
        cautions: what may be wrong with the detections, a sentence each.
    """

    test: TestFrames
    rigs: Mapping[str, Sequence[pd.DataFrame]]
    paths: Mapping[str, Sequence[str]]
    geometry: Mapping[str, Placement]
    notes: Sequence[str]
    cautions: Sequence[str]


def asked_for(
    log: Path,
    detections: Sequence[Path],
    rigs: Sequence[str],
    geometry: Sequence[str],
    layout: str | None,
    world: bool,
    calib: Path | None,
    class_map: str,
    roi: Sequence[float],
    classes: Sequence[str],
    split: str,
    counted: str,
    accept: Sequence[str],
) -> EvaluationRequest:
    """Read what the options of `sweeps.options` name. Raises OSError, ValueError."""
    if bool(detections) == bool(rigs):
        problem = "both, or none" if detections else "no detections"
        expected = "DETECTIONS of one rig, or --rig NAME=PATH for each of several"
        raise InputError(problem, place="DETECTIONS, --rig", expected=expected)
    paths = _by_rig("--rig", rigs) or {ALONE: [str(path) for path in detections]}
    files = {name: [[Path(own)] for own in each] for name, each in paths.items()}
    if detections:
        files = {ALONE: [[*detections]]}
    crop, own_map = crop_of(roi), named_class_map(class_map)
    form = None if layout is None else known("layout", layout, {own: own for own in LAYOUTS})
    rule = known("counted", counted, {str(name): name for name in get_args(Counted)})
    part = known("split", split, {own: own for own in SPLITS})
    checks = {name: name for name in get_args(DetectionCheck)}
    accepted = [known("accept", name, checks) for name in accept]
    whole = read_box_log(log)
    test = TestFrames.of(whole, part, crop, classes, rule)
    found: dict[str, list[pd.DataFrame]] = {}
    notes, cautions = [test.said], []
    for name, trainings in files.items():
        for of_training in trainings:
            ignored = Counter[str]()
            read = read_detections(
                of_training,
                whole,
                test.classes,
                layout=form,
                world=world,
                calibration=calib,
                class_map=own_map,
                ignored=ignored,
            )
            own = read[read["frame"].isin(test.log.frames["frame"])]
            place = ", ".join(map(str, of_training))
            if own.empty:
                raise InputError("no detection of a class in a frame of the split", place=place)
            compared = own, test.objects, test.log.frames, place
            cautions += check_detections(*compared, accepted, "--accept {}")
            found.setdefault(name, []).append(kept := test.relevant(own))
            there, every = own["frame"].nunique(), len(test.log.frames)
            text = f"{name}: {len(kept):,} of {len(own):,} detections count"
            without = f"; without class: {listed(dict(ignored.most_common()))}" if ignored else ""
            notes.append(f"{text}, in {there:,} of {every:,} frames{without}.")
            if there < every:
                cautions.append(f"{name}: no detection in {every - there:,} test frames.")
    places = {}
    for name, (where, *second) in _by_rig("--geometry", geometry).items():
        if name not in found or second:
            expected = f"one for each of {', '.join(found)}"
            place = f"--geometry {name}={where}"
            raise InputError("no rig, or a second geometry", place=place, expected=expected)
        if where.endswith((".yaml", ".yml")):
            places[name] = read_placement(Path(where), PROFILES["paper"].lidar)
        else:
            rig = one_rig(whole.rigs)
            own_rig = rig if where == "recorded" else rig.subset(where.split("+"))
            places[name] = own_rig.placement
    return EvaluationRequest(test, found, paths, places, notes, cautions)


def _by_rig(option: str, pairs: Sequence[str]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for pair in pairs:
        name, _, value = pair.partition("=")
        if not (name and value):
            raise InputError("no rig", place=option, expected="NAME=VALUE", found=pair)
        found.setdefault(name, []).append(value)
    return found
