"""Generalists in files: the weights of one detector for many rigs, and its training conditions."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from pydantic import ConfigDict, TypeAdapter
from torch import Tensor

from lidarplace.base.errors import InputError
from lidarplace.base.roi import Roi
from lidarplace.clouds.clouds import Crop
from lidarplace.clouds.collect import SimulatedClouds, crop_for
from lidarplace.clouds.surroundings import Surroundings
from lidarplace.clouds.visibility import ground_truth
from lidarplace.logs.box_log import BoxLog, read_box_log
from lidarplace.logs.boxes import CLASSES
from lidarplace.mounting.errors import MountingErrors
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.rigs.placement import Placement
from training.checkpoints import read_checkpoint
from training.detect import Predictor
from training.kitti_ap import evaluation
from training.settings import PRETRAINED, TrainingSettings
from training.typical_objects import TypicalObject, from_plain

Interval = tuple[float, float]


@dataclass(frozen=True)
class Domain:
    """Ranges of the rigs of a training, each from the smallest to the largest value."""

    __pydantic_config__ = ConfigDict(extra="forbid")

    lidars: Interval  # number of LiDARs of a rig
    rays: Interval  # of all LiDARs of a rig in a frame
    height: Interval  # of a LiDAR above the ground, metres
    beams: Interval | None  # of a LiDAR whose beams turn; None: there was none
    elevation: Interval  # of a beam, or a ray of a pattern that does not repeat, degrees
    x: Interval  # region in which objects counted, ego frame, metres
    y: Interval
    z: Interval
    patterns: bool  # whether there were LiDARs with a pattern that does not repeat
    classes: tuple[str, ...]

    def outside(self, placement: Placement, crop: Crop, classes: Sequence[str]) -> str | None:
        """Describe the first difference, such as "9 LiDARs; expected 1 to 8"; None: no difference.

        Of a rig, whose LiDARs have as many azimuth steps as their clouds are simulated with, the
        lowest and the highest corner of its ROI, ego frame, metres, and the classes that count."""
        rig = domain_of([placement], crop, classes)
        for name in rig.classes:
            if name not in self.classes:
                return f"class {name}; expected {', '.join(self.classes)}"
        if rig.patterns and not self.patterns:
            return "a LiDAR whose pattern does not repeat; expected beams that turn"
        for name, words in _WORDS.items():
            trained, slack = getattr(self, name), _SLACK.get(name, 0.0)
            for value in getattr(rig, name) or ():
                if trained is None or not trained[0] - slack <= value <= trained[1] + slack:
                    limits = (
                        "none" if trained is None else f"{trained[0]:,.7g} to {trained[1]:,.7g}"
                    )
                    return f"{words.format(f'{value:,.7g}')}; expected {limits}"
        return None


_SLACK = {"height": 0.1, "elevation": 1.0, "rays": 500.0}
"""Distance from the extremes of rigs drawn at random that is still inside."""
_WORDS = {
    "lidars": "{} LiDARs",
    "rays": "{} rays a frame",
    "height": "a LiDAR at a height of {} m",
    "beams": "a LiDAR of {} beams",
    "elevation": "a beam at {} degrees",
    "x": "a ROI with x = {} m",
    "y": "a ROI with y = {} m",
    "z": "a ROI with z = {} m",
}
_DOMAIN = TypeAdapter(Domain)


def domain_of(placements: Iterable[Placement], crop: Crop, classes: Sequence[str]) -> Domain:
    """Compute the domain of a training on these rigs; arguments as of `Domain.outside`."""
    rigs = list(placements)
    lidars = list(dict.fromkeys(lidar for rig in rigs for lidar in rig.lidars))
    turning = [lidar for lidar in lidars if lidar.pattern is None]
    return Domain(
        lidars=_interval(len(rig.mounts) for rig in rigs),
        rays=_interval(sum(lidar.rays for lidar in rig.lidars) for rig in rigs),
        height=_interval(mount.z for rig in rigs for mount in rig.mounts),
        beams=_interval(len(lidar.elevations) for lidar in turning) if turning else None,
        elevation=_interval(math.degrees(angle) for lidar in lidars for angle in lidar.elevations),
        x=(crop[0], crop[3]),
        y=(crop[1], crop[4]),
        z=(crop[2], crop[5]),
        patterns=len(turning) < len(lidars),
        classes=tuple(classes),
    )


def _interval(values: Iterable[float]) -> Interval:
    numbers = [float(value) for value in values]
    return min(numbers), max(numbers)


@dataclass(frozen=True, eq=False)
class Generalist:
    """Detector that was read from a file."""

    detector: str  # its name for `build_detector`
    classes: tuple[str, ...]  # the labels 1, 2, …
    typical: tuple[TypicalObject, ...]  # objects of which the anchors are that are not the preset's
    domain: Domain  # what it was trained on
    state_dict: dict[str, Tensor]  # weights, CPU tensors
    digest: str  # SHA-256 of the file


def read_generalist(path: Path = PRETRAINED) -> Generalist:
    """Read what `lidarplace pretrain` wrote; by default the generalist of the package.

    Raises OSError if the file cannot be read, InputError or ValueError if it is no checkpoint, or
    does not say what it was trained on."""
    content, digest = read_checkpoint(path)
    try:
        domain = _DOMAIN.validate_python(content["domain"])
        name, classes = str(content["detector"]), tuple(content["classes"])
        weights = dict(content["model_state"])
        return Generalist(name, classes, from_plain(content), domain, weights, digest)
    except (KeyError, TypeError, ValueError) as error:
        fault, fix = "the checkpoint does not say what it was trained on", "lidarplace pretrain"
        raise InputError(fault, place=path, fix=f"write it with {fix}") from error


def evaluate_rigs(
    placements: Sequence[Placement],
    log: BoxLog | Path | str,
    roi: Roi,
    classes: Sequence[str] = CLASSES,
    *,
    split: str = "test",
    errors: MountingErrors = MountingErrors(),
    vehicle: Vehicle | None = None,
    seed: int = 0,
    weights: Path | str = PRETRAINED,
) -> list[pd.DataFrame]:
    """Compute AP and recall of rigs by a generalist, without a training, in seconds.

    Clouds are simulated with the azimuth steps that the LiDARs have, and forgotten. The rigs share
    log, surroundings, ground truth and network.

    Args:
        placements: the rigs.
        log: what is around the vehicle, or its folder.
        roi: where objects count, ego frame, metres.
        classes: classes to detect.
        split: of the frames, "train" or "test"; "": all of them.
        errors: of mounts in the clouds.
        vehicle: that carries the rigs; None: a sedan.
        seed: of noise, and of the shapes of the objects.
        weights: a file of `lidarplace pretrain`; by default the package's.

    Returns `metrics` of `training.kitti_ap.Evaluation` for each rig, percent.

    Raises OSError if log or weights cannot be read; InputError or ValueError if they are not what
    they should be, no frame is of the split, or rig, ROI or a class are outside of what the
    generalist was trained on."""
    if not placements:
        return []
    generalist = read_generalist(Path(weights))
    crop = crop_for(roi.x, roi.y, roi.z, placements[0])
    for placement in placements:
        outside = generalist.domain.outside(placement, crop, classes)
        if outside is not None:
            place = f"placement {placement.name}"
            raise InputError(f"outside of what {weights} was trained on: {outside}", place=place)
    log = log if isinstance(log, BoxLog) else read_box_log(Path(log))
    frames = log.frames[log.frames["split"] == split] if split else log.frames
    if frames.empty:
        raise InputError(f"no frame is in the {split} split", place="log")
    numbers = frames["frame"].to_numpy(np.int64)
    whole = log
    log = replace(log, boxes=log.boxes[log.boxes["frame"].isin(numbers)])  # others hide nothing
    moving = any(placement.takes_time for placement in placements)  # but show motion
    surroundings = Surroundings(whole if moving else log, seed)
    network = (generalist.detector, generalist.classes, generalist.state_dict)
    predictor = Predictor(*network, TrainingSettings(), crop, generalist.typical)
    objects = ground_truth(log, roi.x, roi.y, roi.z, seed=seed)
    tables = []
    for placement in placements:
        clouds = SimulatedClouds(
            surroundings, numbers, placement, crop, seed, errors=errors, vehicle=vehicle
        )
        boxes = predictor.detect(clouds).boxes
        tables.append(evaluation(objects, boxes, numbers.tolist(), classes).metrics)
    return tables
