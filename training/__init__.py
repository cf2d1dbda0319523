"""Detectors, their training and their evaluation."""

from __future__ import annotations

import importlib
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from lidarplace.boxes import CLASSES

if TYPE_CHECKING:
    from training.detectors.detector import Detector, PointRange

NETWORKS = (
    "pointpillars",
    "second",
    "second_iou",
    "voxel_rcnn",
    "pointrcnn",
    "pointrcnn_iou",
    "pv_rcnn",
)
"""The networks; `training.detectors` has a module of each name."""

PRESETS = ("openpcdet", "paper", "tiny")
"""KITTI's network as OpenPCDet configures it, the paper's changes to it, and one for CPUs."""

DETECTORS = tuple(name + tail for name in NETWORKS for tail in ("", "_paper", "_tiny"))
"""Names that `build_detector` knows: a network (preset "openpcdet") or one with its preset."""


def build_detector(
    name: str,
    classes: Sequence[str],
    preset: str | None = None,
    point_range: PointRange | None = None,
) -> Detector:
    """An untrained detector.

    Args:
        name: one of DETECTORS; "second_tiny" is "second" with preset "tiny".
        classes: object classes, the labels 1, 2, … in this order.
        preset: one of PRESETS; "openpcdet" if neither this nor the name says else. "openpcdet" and
            "paper" work in KITTI's LiDAR frame, 1.73 m above the ground, "tiny" in the ego frame.
        point_range: x, y, z of the lowest and of the highest corner in the ego frame, metres, in
            place of the preset's; its far ends move out to a whole number of cells. In KITTI's
            frame the preset's heights stay, to which the weights belong.

    Raises:
        ValueError: unknown name, class or preset, no class or one named twice, an empty range.
    """
    if name not in DETECTORS:
        raise ValueError(f"unknown detector {name!r}; choose one of {', '.join(DETECTORS)}")
    unknown = [item for item in classes if item not in CLASSES]
    if unknown or not classes or len(set(classes)) < len(classes):
        raise ValueError(f"classes must be different ones of {CLASSES}, found {list(classes)}")
    network, own = _network_and_preset(name)
    if preset not in (None, *PRESETS):
        raise ValueError(f"unknown preset {preset!r}; choose one of {', '.join(PRESETS)}")
    if own is not None and preset not in (None, own):
        raise ValueError(f"{name} has preset {own!r}, found {preset!r}")
    if point_range is not None and not all(
        -math.inf < low < high < math.inf
        for low, high in zip(point_range[:3], point_range[3:], strict=True)
    ):
        raise ValueError(f"point_range needs finite low < high on every axis, found {point_range}")
    # torch takes seconds to import, and who only evaluates does not need it.
    from training.vector_math import settle_vector_math

    settle_vector_math()
    module = importlib.import_module(f"training.detectors.{network}")
    return module.build(classes, own or preset or "openpcdet", point_range)


def network_of(detector: str) -> str:
    """The one of NETWORKS that a detector is."""
    return _network_and_preset(detector)[0]


def _network_and_preset(name: str) -> tuple[str, str | None]:
    for preset in ("paper", "tiny"):
        if name.endswith(f"_{preset}"):
            return name.removesuffix(f"_{preset}"), preset
    return name, None
