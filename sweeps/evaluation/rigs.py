"""The rigs that a command compares: their detections, and where their LiDARs are."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from lidarplace.base.class_names import listed
from lidarplace.base.errors import InputError
from lidarplace.clouds.profiles import PROFILES
from lidarplace.configuration.placement import read_placement
from lidarplace.detections.read import Layout, read_detections
from lidarplace.logs.box_log import BoxLog
from lidarplace.rigs.placement import Placement
from lidarplace.rigs.recorded import one_rig
from lidarplace.scenes.datasets.class_maps import ClassMap
from sweeps.evaluation.test_frames import TestFrames

RECORDED = "recorded"
"""Geometry of the rig that recorded the log."""


@dataclass(frozen=True)
class How:
    """How files of detections are read; attributes as of `read_detections`."""

    layout: Layout | None = None
    world: bool = False
    calibration: Path | None = None
    class_map: ClassMap | None = None


@dataclass(frozen=True)
class FoundBy:
    """What the detectors of a rig found in the test frames.

    Attributes:
        name: of the rig.
        seeds: detections that count, by training of the detector.
        said: how many count, a sentence for each of `seeds`.
        cautions: a sentence for each of `seeds` that has no detection in some of the frames.
    """

    name: str
    seeds: tuple[pd.DataFrame, ...]
    said: tuple[str, ...]
    cautions: tuple[str, ...]


def read_rigs(
    paths: Mapping[str, Sequence[Sequence[Path]]], whole: BoxLog, test: TestFrames, how: How
) -> list[FoundBy]:
    """Read the detections of rigs.

    Args:
        paths: by rig, of each training of its detector the files.
        whole: log of which `test` is the split: detections may be of its other frames, too.

    Raises:
        InputError: a file is wrong, or has no detection of a test frame.
    """
    rigs, frames = [], test.log.frames["frame"]
    for name, trainings in paths.items():
        seeds, said, cautions = [], [], []
        for files in trainings:
            ignored = Counter[str]()
            read = read_detections(
                files,
                whole,
                test.classes,
                layout=how.layout,
                world=how.world,
                calibration=how.calibration,
                class_map=how.class_map,
                ignored=ignored,
            )
            own = read[read["frame"].isin(frames)]
            if own.empty:
                place = ", ".join(map(str, files))
                raise InputError("no detection of a class in a frame of the split", place=place)
            kept = test.relevant(own)
            seeds.append(kept)
            there = own["frame"].nunique()
            text = f"{name}: {len(kept):,} of {len(own):,} detections count"
            without = f"; without class: {listed(dict(ignored.most_common()))}" if ignored else ""
            said.append(f"{text}, in {there:,} of {len(frames):,} frames{without}.")
            if there < len(frames):
                cautions.append(f"{name}: no detection in {len(frames) - there:,} test frames.")
        rigs.append(FoundBy(name, tuple(seeds), tuple(said), tuple(cautions)))
    return rigs


def by_rig(pairs: Sequence[str], option: str = "--rig") -> dict[str, list[str]]:
    """Values by name of options NAME=VALUE. Raises InputError."""
    found: dict[str, list[str]] = {}
    for pair in pairs:
        name, equals, value = pair.partition("=")
        if not (name and equals and value):
            raise InputError("no rig", place=option, expected="NAME=VALUE", found=pair)
        found.setdefault(name, []).append(value)
    return found


def geometries(pairs: Sequence[str], log: BoxLog, rigs: Sequence[str]) -> dict[str, Placement]:
    """Where the LiDARs of rigs are, from options NAME=recorded|LIDAR+LIDAR|FILE.yaml.

    Raises:
        InputError: a rig is unknown or has two.
        ValueError: a file or a name of a LiDAR is wrong, or the log knows no rig.
    """
    found = {}
    for name, values in by_rig(pairs, "--geometry").items():
        if name not in rigs or len(values) > 1:
            expected = f"one for each of {', '.join(rigs)}"
            place = f"--geometry {name}={values[-1]}"
            raise InputError("no rig, or a second geometry", place=place, expected=expected)
        if values[0].endswith((".yaml", ".yml")):
            found[name] = read_placement(Path(values[0]), PROFILES["paper"].lidar)
        else:
            rig = one_rig(log.rigs)
            own = rig if values[0] == RECORDED else rig.subset(values[0].split("+"))
            found[name] = own.placement
    return found
