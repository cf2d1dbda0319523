"""Detectors, their training and their evaluation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from pydantic_core import PydanticCustomError

from lidarplace.base.errors import InputError
from lidarplace.base.registry import OneOf, Registry
from training.detectors.build import PLUG_INS, build, network_and_preset
from training.detectors.build import PRESETS as PRESETS
from training.typical_objects import TypicalObject

if TYPE_CHECKING:
    from training.detectors.detector import Detector, PointRange

_OWN = (
    "pointpillars",
    "second",
    "second_iou",
    "voxel_rcnn",
    "pointrcnn",
    "pointrcnn_iou",
    "pv_rcnn",
)

NETWORKS: Registry[Any] = Registry(PLUG_INS.group, {n: f"training.detectors.{n}" for n in _OWN})
"""Networks: a module of this package, or the function `build` of a plug-in."""

DETECTORS = OneOf((NETWORKS.where(lambda own: True),), tails=("", "_paper", "_tiny"))
"""Names for `build_detector`: a network (preset "openpcdet") or one with its preset."""


def build_detector(
    name: str,
    classes: Sequence[str],
    preset: str | None = None,
    point_range: PointRange | None = None,
    typical: Sequence[TypicalObject] = (),
) -> Detector:
    """Build an untrained detector.

    Args:
        name: one of DETECTORS; "second_tiny" is "second" with preset "tiny".
        classes: object classes, the labels 1, 2, … in this order.
        preset: one of PRESETS; "openpcdet" if neither this nor the name says else. "openpcdet" and
            "paper" work in KITTI's LiDAR frame, 1.73 m above the ground, "tiny" in the ego frame.
        point_range: x, y, z of the lowest and of the highest corner in the ego frame, metres, in
            place of the preset's; its far ends move out to a whole number of cells. In KITTI's
            frame the preset's heights stay, to which the weights belong.
        typical: of classes that the preset does not know, or that shall have other anchors; see
            `training.typical_objects`.

    Raises:
        ValueError: unknown name, class or preset, no class or one named twice, an empty range."""
    try:
        DETECTORS.check(name)
    except PydanticCustomError:
        names = ", ".join(DETECTORS.names())
        raise InputError(f"unknown detector {name!r}", expected=f"one of {names}") from None
    return build(name, classes, preset, point_range, typical)


def network_of(detector: str) -> str:
    """Return the one of NETWORKS that a detector is."""
    return network_and_preset(detector)[0]


def code_of_network(network: str) -> tuple[str, ...]:
    """List the dotted paths of the code that only this network needs."""
    module = network if network in NETWORKS.own else "build"
    return (f"training.detectors.{module}", *NETWORKS.modules([network]))
