"""Detections that the options of a command name, and the test frames that they belong to."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
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
from lidarplace.configuration.vehicle import read_vehicle
from lidarplace.detections.read import LAYOUTS, read_detections
from lidarplace.logs.box_log import BoxLog, read_box_log
from lidarplace.logs.boxes import SPLITS
from lidarplace.logs.plausibility import DetectionCheck
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.placement import Placement
from lidarplace.rigs.recorded import one_rig
from lidarplace.scenes.datasets.class_maps import named_class_map
from sweeps.evaluation.test_frames import Counted, TestFrames
from training.sanity_checks.check import check_detections

ALONE = "detections"
"""Name of a rig that got none."""


@dataclass(frozen=True, kw_only=True)
class DetectionOptions:
    """Options of `sweeps.options` as they were typed; see their help.

    `detections` are the files of one rig, `rigs` NAME=PATH of several."""

    log: Path
    detections: Sequence[Path] | None = None
    rigs: Sequence[str] | None
    geometry: Sequence[str] | None
    vehicle: Path | None
    layout: str | None
    world: bool
    calib: Path | None
    class_map: str
    roi: Sequence[float]
    classes: Sequence[str] | None
    split: str
    counted: str = "visible"
    accept: Sequence[str] | None


@dataclass(frozen=True)
class EvaluationRequest:
    """Detections of rigs in test frames.

    Attributes:
        rigs: detections that are right or wrong about objects that count, by rig and by training.
        paths: of the files, by rig.
        geometry: placements of rigs whose LiDARs are known.
        vehicle: carries the LiDARs; None: a sedan.
        notes: number of objects and detections that count, a sentence each.
        cautions: possible faults of the detections, a sentence each."""

    test: TestFrames
    rigs: Mapping[str, Sequence[pd.DataFrame]]
    paths: Mapping[str, Sequence[str]]
    geometry: Mapping[str, Placement]
    vehicle: Vehicle | None
    notes: Sequence[str]
    cautions: Sequence[str]


def read_request(options: DetectionOptions) -> EvaluationRequest:
    """Read the files that options name. Raises OSError, ValueError."""
    if bool(options.detections) == bool(options.rigs):
        problem = "both, or none" if options.detections else "no detections"
        expected = "DETECTIONS of one rig, or --rig NAME=PATH for each of several"
        raise InputError(problem, place="DETECTIONS, --rig", expected=expected)
    paths = _by_rig("--rig", options.rigs or ())
    files = {name: [[Path(path)] for path in of_rig] for name, of_rig in paths.items()}
    if options.detections:
        paths = {ALONE: [str(path) for path in options.detections]}
        files = {ALONE: [[*options.detections]]}
    layouts = {str(name): name for name in LAYOUTS}
    layout = None if options.layout is None else known("layout", options.layout, layouts)
    counted = known("counted", options.counted, {name: name for name in get_args(Counted)})
    split = known("split", options.split, {name: name for name in SPLITS})
    checks = {name: name for name in get_args(DetectionCheck)}
    accepted = [known("accept", name, checks) for name in options.accept or ()]
    vehicle = None if options.vehicle is None else read_vehicle(options.vehicle)
    crop, class_map = crop_of(options.roi), named_class_map(options.class_map)
    log = read_box_log(options.log)
    test = TestFrames.of(log, split, crop, options.classes or (), counted)
    detections: dict[str, list[pd.DataFrame]] = {name: [] for name in files}
    notes, cautions = [test.description], list[str]()
    for name, training in ((name, one) for name, of_rig in files.items() for one in of_rig):
        unmapped = Counter[str]()
        every = read_detections(
            training,
            log,
            test.classes,
            layout=layout,
            world=options.world,
            calibration=options.calib,
            class_map=class_map,
            ignored=unmapped,
        )
        tested = every[every["frame"].isin(test.log.frames["frame"])]
        place = ", ".join(map(str, training))
        if tested.empty:
            raise InputError("no detection of a class in a frame of the split", place=place)
        compared = tested, test.objects, test.log.frames, place
        cautions += check_detections(*compared, accepted, "--accept {}")
        relevant = test.relevant(tested)
        detections[name].append(relevant)
        frames, most = tested["frame"].nunique(), len(test.log.frames)
        text = f"{name}: {len(relevant):,} of {len(tested):,} detections count"
        without = f"; without class: {listed(dict(unmapped.most_common()))}" if unmapped else ""
        notes.append(f"{text}, in {frames:,} of {most:,} frames{without}.")
        if frames < most:
            cautions.append(f"{name}: no detection in {most - frames:,} test frames.")
    places = _geometry(options.geometry or (), files, log)
    return EvaluationRequest(test, detections, paths, places, vehicle, notes, cautions)


def _geometry(pairs: Sequence[str], rigs: Iterable[str], log: BoxLog) -> dict[str, Placement]:
    """Return placements by rig: of a file, or LiDARs of the rig that recorded the log."""
    placements = {}
    for name, (source, *second) in _by_rig("--geometry", pairs).items():
        if name not in rigs or second:
            expected = f"one for each of {', '.join(rigs)}"
            place = f"--geometry {name}={source}"
            raise InputError("no rig, or a second geometry", place=place, expected=expected)
        if source.endswith((".yaml", ".yml")):
            placements[name] = read_placement(Path(source), PROFILES["paper"].lidar)
        else:
            rig = one_rig(log.rigs)
            rig = rig if source == "recorded" else rig.subset(source.split("+"))
            placements[name] = rig.placement
    return placements


def _by_rig(option: str, pairs: Sequence[str]) -> dict[str, list[str]]:
    values: dict[str, list[str]] = {}
    for pair in pairs:
        name, _, value = pair.partition("=")
        if not (name and value):
            raise InputError("no rig", place=option, expected="NAME=VALUE", found=pair)
        values.setdefault(name, []).append(value)
    return values
