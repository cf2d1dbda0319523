"""Files that a point names: detection curves, a checkpoint to start from, what a command needs."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from lidarplace.base.errors import InputError, at
from lidarplace.clouds.clouds import Crop
from lidarplace.clouds.collect import crop_for
from lidarplace.files.regular import regular
from lidarplace.recall.detection_curve import IOU, DetectionCurves, default_curves, read_curves
from lidarplace.rigs.placement import Placement
from sweeps.configuration.file import reading
from sweeps.configuration.point import Point
from training import NETWORKS, build_detector, network_of
from training.settings import PRETRAINED
from training.typical_objects import TypicalObject, from_plain

if TYPE_CHECKING:
    from training.pretrained import Generalist


def curve_names(point: Point) -> tuple[tuple[str, str | None], ...]:
    """List the classes that need a detection curve, each with the one whose curve it borrows."""
    if "expected_recall" not in point.surrogate.names:
        return ()
    settings = point.class_settings
    return tuple(
        (name, settings[name].curve if name in settings else None) for name in point.classes
    )


def curves_of(path: Path | None, classes: Sequence[tuple[str, str | None]]) -> DetectionCurves:
    """Read detection curves, with one for each of `classes`: its own, or that of another."""
    with reading("surrogate.curves"):
        curves = default_curves() if path is None else read_curves(path)
        for name, other in classes:
            if other is not None and curves.has(name, IOU):
                fix = f"remove class_settings.{name}.curve"
                raise InputError(f"has a curve of {name} of its own", fix=fix)
            if other is not None:
                curves = curves.lent(other, name, IOU)
            if not curves.has(name, IOU):
                names = [curve.object_class for curve in curves.curves if curve.iou == IOU]
                problem = f"expected_recall has no detection curve of {name} at IoU {IOU:g}"
                fix = "remove expected_recall from surrogate.names, borrow a curve with "
                fix += f"class_settings.{name}.curve, or fit one with lidarplace calibrate"
                raise InputError(problem, expected=", ".join(names), fix=fix)
    return curves


def checkpoint_of(
    path: Path,
    new_heads: bool,
    detector: str,
    classes: Sequence[str],
    point_range: Crop,
    typical: tuple[TypicalObject, ...],
    fixed: frozenset[str],
) -> tuple[str, tuple[TypicalObject, ...]]:
    """Return the SHA-256 of a checkpoint that fits, and the typical objects of the classes.

    Those of the checkpoint, unless `new_heads` are trained, come before those of the data; `fixed`
    classes have those of the configuration."""
    # torch, which a sweep from scratch need not wait for
    from training.checkpoints import load_checkpoint, read_checkpoint

    with reading("training.checkpoint"):
        by_name = {item.name: item for item in typical}
        if not new_heads:
            trained = from_plain(read_checkpoint(path)[0])
            by_name |= {t.name: t for t in trained if t.name in classes and t.name not in fixed}
        typical = tuple(by_name[name] for name in classes if name in by_name)
        model = build_detector(detector, classes, point_range=point_range, typical=typical)
        return load_checkpoint(model, path, new_heads).digest, typical


def generalist_of(point: Point) -> Generalist:
    """Return the generalist of `evaluator: pretrained`.

    Raises InputError: the file cannot be read, or belongs to another network."""
    path = point.training.checkpoint or PRETRAINED
    with reading("training.checkpoint"):
        generalist = _read_generalist(path)
    if point.detector != (expected := generalist.detector):
        problem = f"{path} has weights of another network"
        raise InputError(problem, key="detector", expected=expected, found=point.detector)
    return generalist


def outside_of(point: Point, rig: Placement) -> str | None:
    """Describe how a rig, the ROI or a class differs from what the pretrained weights know.

    `rig`: with the LiDARs of its clouds. A line, or None if nothing does. Raises InputError: see
    `generalist_of`."""
    roi = point.roi
    crop = crop_for(roi.x, roi.y, roi.z, rig)
    outside = generalist_of(point).domain.outside(rig, crop, point.classes)
    return outside and (
        f"outside of what evaluator: pretrained was trained on: {outside}; "
        "evaluator: generalist trains a detector for these rigs"
    )


@cache
def _read_generalist(path: Path) -> Generalist:
    from training.pretrained import read_generalist  # torch

    return read_generalist(path)


def check_network(
    detector: str, classes: Sequence[str], point_range: Crop, typical: tuple[TypicalObject, ...]
) -> None:
    """Build a network of a plug-in, to report errors before hours of scenes."""
    if NETWORKS.modules([network_of(detector)]):
        with at(key="detector"):
            build_detector(detector, classes, point_range=point_range, typical=typical)


def digests_of(paths: Sequence[Path]) -> tuple[str, ...]:
    """Hash the content of files, and of folders with the names in them."""
    digests = []
    for path in paths:
        with reading("evaluator.depends_on"):
            if path.is_dir():
                files = (
                    file for file in path.rglob("*") if file.is_file() and file.suffix != ".pyc"
                )
                parts = [
                    b"%s\0%s" % (bytes(f.relative_to(path)), _digest(f)) for f in sorted(files)
                ]
                digests.append(hashlib.sha256(b"".join(parts)).hexdigest())
            else:
                digests.append(_digest(path).hex())
    return tuple(digests)


def _digest(path: Path) -> bytes:
    with regular(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").digest()
