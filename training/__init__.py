"""Detectors, their training and their evaluation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from lidarplace.boxes import CLASSES

if TYPE_CHECKING:
    from training.detectors.detector import Detector, PointRange

DETECTORS = ("pointpillars", "pointpillars_tiny")
"""Names that `build_detector` knows."""

PRESETS = ("openpcdet", "tiny")


def build_detector(
    name: str,
    classes: Sequence[str],
    preset: str | None = None,
    point_range: PointRange | None = None,
) -> Detector:
    """An untrained detector.

    Args:
        name: one of DETECTORS; "pointpillars_tiny" is "pointpillars" with preset "tiny".
        classes: object classes, the labels 1, 2, … in this order.
        preset: "openpcdet" (KITTI's network, in KITTI's LiDAR frame; the default) or "tiny" (for
            CPUs, in the ego frame).
        point_range: x, y, z of the lowest and of the highest corner in the ego frame, metres, in
            place of the preset's; it grows in x and y to a whole number of cells.

    Raises:
        ValueError: unknown name, class or preset, no class or one named twice, an empty range.
    """
    # torch takes seconds to import, and who only evaluates does not need it.
    from training.detectors.pointpillars import OPENPCDET, TINY, PointPillars

    if name not in DETECTORS:
        raise ValueError(f"unknown detector {name!r}; choose one of {', '.join(DETECTORS)}")
    unknown = [item for item in classes if item not in CLASSES]
    if unknown or not classes or len(set(classes)) < len(classes):
        raise ValueError(f"classes must be different ones of {CLASSES}, found {list(classes)}")
    if name == "pointpillars_tiny":
        if preset not in (None, "tiny"):
            raise ValueError(f"pointpillars_tiny has preset 'tiny', found {preset!r}")
        preset = "tiny"
    if preset not in (None, *PRESETS):
        raise ValueError(f"unknown preset {preset!r}; choose one of {', '.join(PRESETS)}")
    if point_range is not None and not all(
        low < high for low, high in zip(point_range[:3], point_range[3:], strict=True)
    ):
        raise ValueError(f"point_range needs low < high on every axis, found {point_range}")
    return PointPillars(classes, TINY if preset == "tiny" else OPENPCDET, point_range)
