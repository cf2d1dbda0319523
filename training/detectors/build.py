"""A detector by its name: each network is a module next to this one, with a function `build`."""

from __future__ import annotations

import importlib
import math
from collections.abc import Sequence
from contextlib import nullcontext
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from lidarplace.base.class_names import check_class_name
from lidarplace.base.errors import InputError
from lidarplace.base.foreign_code import foreign_code
from lidarplace.base.registry import Registry
from lidarplace.base.suggestions import did_you_mean
from lidarplace.logs.boxes import CLASSES
from training.typical_objects import TypicalObject

if TYPE_CHECKING:
    from training.detectors.detector import Detector, PointRange

PLUG_INS: Registry[Any] = Registry("lidarplace.detectors", {})
"""Functions `build` of other packages."""

PRESETS = ("openpcdet", "paper", "tiny")
"""Presets: OpenPCDet's for KITTI, the paper's changes to it, and one for a CPU core."""


def build(
    name: str,
    classes: Sequence[str],
    preset: str | None = None,
    point_range: PointRange | None = None,
    typical: Sequence[TypicalObject] = (),
) -> Detector:
    """Build a detector as `training.build_detector`, which names the detectors in its error.

    It does without the table of networks, so that a further one is no change to a training's code.
    """
    _check_classes(classes, typical)
    network, named_preset = network_and_preset(name)
    plug_in = PLUG_INS.path(network) is not None and PLUG_INS[network]
    if not plug_in and find_spec(f"training.detectors.{network}") is None:
        raise InputError(f"unknown detector {name!r}")
    allowed = PRESETS if named_preset is None else (named_preset,)
    if preset not in (None, *allowed):
        wanted = " or ".join(allowed)
        raise InputError(place=name, key="preset", expected=wanted, found=repr(preset))
    if point_range is not None and not all(
        -math.inf < low < high < math.inf
        for low, high in zip(point_range[:3], point_range[3:], strict=True)
    ):
        wanted = "finite low < high on every axis"
        raise InputError(key="point_range", expected=wanted, found=point_range)
    # torch takes seconds to import, and who only evaluates does not need it.
    from training.detectors.detector import Detector
    from training.device import settle_vector_math

    settle_vector_math()
    make = plug_in or importlib.import_module(f"training.detectors.{network}").build
    with foreign_code(network) if plug_in else nullcontext():
        model = make(classes, named_preset or preset or "openpcdet", point_range, typical)
    if not isinstance(model, Detector):
        expected, kind = "a Detector, see training.detectors.detector", type(model).__name__
        raise InputError("wrong type", place=network, expected=expected, found=kind)
    model.typical = tuple(item for item in typical if item.name in classes)
    return model


def _check_classes(classes: Sequence[str], typical: Sequence[TypicalObject]) -> None:
    """Raise ValueError unless these are different names of classes whose size is known."""
    if isinstance(classes, str):
        wanted, fix = "a list of names", f"write [{classes!r}]"
        raise InputError(key="classes", expected=wanted, found=repr(classes), fix=fix)
    if not classes or len(set(classes)) < len(classes):
        raise InputError(key="classes", expected="different names, at least one", found=[*classes])
    for name in classes:
        check_class_name(name, key="classes")
        if name not in CLASSES and name not in [item.name for item in typical]:
            fault = f"unknown size of {name}{did_you_mean(name, CLASSES)}"
            wanted = f"{', '.join(CLASSES)}, or a `typical` object"
            raise InputError(fault, key="classes", expected=wanted)


def network_and_preset(name: str) -> tuple[str, str | None]:
    """Split the name of a detector into its network and preset, if it has one."""
    for preset in ("paper", "tiny"):
        if name.endswith(f"_{preset}") and name not in PLUG_INS:
            return name.removesuffix(f"_{preset}"), preset
    return name, None
