"""Weights from and to files: our base checkpoints, OpenPCDet's checkpoints, plain state_dicts."""

from __future__ import annotations

import hashlib
import io
import pickle
import re
import reprlib
import warnings
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from lidarplace.base.errors import InputError, at
from lidarplace.files.atomic import replacing
from lidarplace.files.regular import regular
from training.detectors.detector import Detector
from training.settings import PRETRAINED
from training.typical_objects import TypicalObject, as_plain, from_plain

_OF_PACKAGE = Path(__file__).parent / "pretrained.pt"

KITTI_ORDER = ("Car", "Pedestrian", "Cyclist")
"""The classes of OpenPCDet's networks for KITTI, in the order of their labels."""


@dataclass(frozen=True)
class LoadReport:
    """Result of `load_checkpoint`."""

    reinitialised: tuple[str, ...]  # entries of heads for other classes, which stay the model's
    digest: str  # SHA-256 of the file


def load_checkpoint(model: Detector, path: Path, new_heads: bool = False) -> LoadReport:
    """Replace the weights of `model` by those of a file.

    The file holds a state_dict, or a dict with one under "model_state" as OpenPCDet and
    `write_checkpoint` write it; nothing but tensors and plain values is ever unpickled. Sparse
    convolutions may be in either layout of spconv 1. A file that does not name its classes is taken
    for one of OpenPCDet, whose order is KITTI_ORDER. With `new_heads` entries of the heads that do
    not fit, because the file is for other classes, keep the model's weights; if it is for as many
    other classes, all entries of the heads do.

    Raises OSError if it cannot be read, and ValueError if it is not a checkpoint, or does not fit;
    names the entries that are missing, unexpected, of another shape or kind, or not finite. The
    model is then left as it was."""
    content, digest = read_checkpoint(path)
    with at(path):
        return LoadReport(_load(model, content, new_heads), digest)


def _load(model: Detector, content: Mapping[str, Any], new_heads: bool) -> tuple[str, ...]:
    loaded = content.get("model_state", content)
    tensors = isinstance(loaded, Mapping) and all(isinstance(v, Tensor) for v in loaded.values())
    if not tensors or not loaded:
        raise InputError("not a checkpoint", expected="a state_dict of tensors")
    current = model.state_dict()
    _same_keys(current, loaded)
    if odd := [key for key in current if not _is_plain(loaded[key], current[key])]:
        key, kind = odd[0], "floats" if current[odd[0]].is_floating_point() else "integers"
        more = f", and so are {len(odd) - 1} more" * (len(odd) > 1)
        wanted, its = f"a dense tensor of {kind}", f"{_kind(loaded[key])}{more}"
        raise InputError(key=key, expected=wanted, found=its)
    loaded = _in_our_layout(current, loaded)
    if broken := [key for key, value in loaded.items() if not torch.isfinite(value).all()]:
        raise InputError(key=_some(broken), expected="finite numbers")
    fresh = [key for key in current if current[key].shape != loaded[key].shape]
    if not fresh:
        fault = _other_classes(model, content) or _other_anchors(model, content)
        if fault and not new_heads:
            raise fault
        fresh = [key for key in current if fault and _of_head(key)]
    elif not (new_heads and all(map(_of_head, fresh))):
        its, ours = (_some([f"{[*of[key].shape]}" for key in fresh]) for of in (loaded, current))
        fix = "new_heads: true trains heads for other classes" * all(map(_of_head, fresh))
        raise InputError("wrong shape", key=_some(fresh), expected=ours, found=its, fix=fix)
    model.load_state_dict({**loaded, **{key: current[key] for key in fresh}})
    return tuple(fresh)


def _other_classes(model: Detector, content: Mapping[str, Any]) -> InputError | None:
    """Fault of a file for as many, but other classes than the detector's."""
    ours = list(model.classes)
    classes = content.get("classes", list(KITTI_ORDER[: len(ours)]))
    if classes == ours:
        return None
    unnamed = " (it names none, and these are OpenPCDet's)" * ("classes" not in content)
    its = f"{reprlib.repr(classes)}{unnamed}"
    fix = "name the classes in the order of the file, or train new heads with new_heads: true"
    return InputError(key="classes", expected=ours, found=its, fix=fix)


def _other_anchors(model: Detector, content: Mapping[str, Any]) -> InputError | None:
    """Fault of a file whose heads belong to other anchors than the detector's."""
    ours, its = ({t.name: t for t in typical} for typical in (model.typical, from_plain(content)))
    for name in sorted(ours.keys() | its.keys()):
        if ours.get(name) != its.get(name):
            our, other = (anchors.get(name, f"{name} as in the preset") for anchors in (ours, its))
            fix = "leave the size out, or train new heads with new_heads: true"
            return InputError("other anchors", expected=our, found=other, fix=fix)
    return None


def write_checkpoint(
    path: Path,
    model_state: Mapping[str, Tensor],
    detector: str,
    classes: Sequence[str],
    typical: Sequence[TypicalObject] = (),
    domain: Mapping[str, Any] | None = None,
) -> None:
    """Write a base checkpoint, from which a fine-tuning can start; a reader never meets half of it.

    The file is a dict: "model_state", the state_dict; "detector", a name for `build_detector`;
    "classes", the names of the labels 1, 2, …; "typical", where there are any, the objects of
    which the anchors are that are not the preset's; and "domain", where it is known, what the
    weights were trained on, see `training.pretrained.Domain`."""
    content: dict[str, object] = {"model_state": dict(model_state)}
    content |= {"detector": detector, "classes": list(classes)}
    if typical:
        content["typical"] = as_plain(typical)
    if domain is not None:
        content["domain"] = dict(domain)
    save_checkpoint(path, content)


def save_checkpoint(path: Path, content: Mapping[str, Any]) -> None:
    """Write a dict of tensors and plain values for `read_checkpoint`, in one step, or OSError."""
    with replacing(path) as partial:
        write_tensors(partial, dict(content))


def write_tensors(path: Path, content: Any) -> None:
    """`torch.save` by way of memory; raises OSError if the file cannot be written.

    Where the disk is full, torch itself raises a RuntimeError that says nothing of the disk, or an
    OSError, depending on which of its writes fails."""
    written = io.BytesIO()
    torch.save(content, written)
    path.write_bytes(written.getbuffer())


def read_checkpoint(path: Path) -> tuple[dict[str, Any], str]:
    """Read the dict in a file, tensors on the CPU, and the SHA-256 of the file.

    Raises OSError: it cannot be read; DamagedCheckpoint: it is not what was written; ValueError: it
    is not a dict of tensors and plain values."""
    path = _OF_PACKAGE if path == PRETRAINED else path
    data = regular(path).read_bytes()
    _check_sums(path, data)
    try:
        with warnings.catch_warnings(record=True, action="always") as messages:
            content = torch.load(io.BytesIO(data), map_location="cpu", weights_only=True)
    except pickle.UnpicklingError as error:
        protocol = re.search(
            r"pickle protocol \d+", " ".join(str(item.message) for item in messages)
        )
        if protocol:  # 3 is loaded all the same
            fault, fix = "could run code", "save it again with torch.save's own pickle_protocol"
            raise InputError(fault, place=path, found=protocol[0], fix=fix) from error
        fault, fix = "not a checkpoint, or has objects that could run code", "save its state_dict"
        wanted = "tensors and plain values"
        raise InputError(fault, place=path, expected=wanted, fix=fix) from error
    # A damaged file raises almost anything, also KeyError and OSError.
    except Exception as error:
        reason = f"{type(error).__name__}: {error}".split("\n")[0]
        raise DamagedCheckpoint(f"{_DAMAGED}: {reason}", place=path) from error
    if not isinstance(content, Mapping):
        kind = type(content).__name__
        raise InputError("not a checkpoint", place=path, expected="a dict", found=kind)
    return dict(content), hashlib.sha256(data).hexdigest()


_DAMAGED = "not a checkpoint, or a damaged one"


class DamagedCheckpoint(InputError):
    """A file that is not what was written."""


def _check_sums(path: Path, data: bytes) -> None:
    """Compare the contents of a checkpoint with their CRC-32, which torch writes and ignores."""
    if not zipfile.is_zipfile(io.BytesIO(data)):  # of a torch before 1.6
        return
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            unpacked = sum(entry.file_size for entry in archive.infolist())
            name = archive.testzip() if unpacked <= len(data) else None
    except Exception as error:  # a damaged archive raises almost anything
        raise DamagedCheckpoint(f"{_DAMAGED}: {error}", place=path) from error
    if unpacked > len(data):
        wanted = "what torch.save writes, not compressed"
        size = f"{unpacked:,} bytes in a file of {len(data):,}"
        raise InputError("not a checkpoint", place=path, expected=wanted, found=size)
    if name is not None:
        raise DamagedCheckpoint(f"{_DAMAGED}: CRC-32 of {name}", place=path)


def _same_keys(current: Mapping[str, Tensor], loaded: Mapping[str, Tensor]) -> None:
    missing = [key for key in current if key not in loaded]
    unexpected = [str(key) for key in loaded if key not in current]
    if missing or unexpected:
        parts = [f"{len(missing)} missing ({_some(missing)})"] * bool(missing)
        parts += [f"{len(unexpected)} unexpected ({_some(unexpected)})"] * bool(unexpected)
        wanted, its = f"{len(current)} entries", f"{len(loaded)}: {', '.join(parts)}"
        raise InputError("weights of another network", expected=wanted, found=its)


# From [out, kd, kh, kw, in] of spconv 2, which is ours: spconv 1.0 had [kd, kh, kw, in, out], its
# "native" successors [kd, kh, kw, out, in]. Axes that turn each of them into ours.
_LAYOUTS = ((0, 1, 2, 3, 4), (4, 0, 1, 2, 3), (3, 0, 1, 2, 4))


def _in_our_layout(
    current: Mapping[str, Tensor], loaded: Mapping[str, Tensor]
) -> Mapping[str, Tensor]:
    """Turn the weights of sparse convolutions into our layout.

    All of a file have one layout, and only all of them together show which: that of one with as
    many inputs as outputs does not show in its shape."""
    sparse = [key for key, value in current.items() if value.ndim == 5]
    for axes in _LAYOUTS:
        moved = {key: loaded[key].permute(axes) for key in sparse if loaded[key].ndim == 5}
        if all(moved[key].shape == current[key].shape for key in moved):
            return {**loaded, **moved}
    return loaded


def _of_head(key: str) -> bool:
    return key.split(".")[0].endswith("_head")


_FLOATS = (torch.float16, torch.bfloat16, torch.float32, torch.float64)
_INTEGERS = (torch.int32, torch.int64)


def _is_plain(value: Tensor, current: Tensor) -> bool:
    """Test if a tensor holds numbers that may take the place of `current`, rounded at most."""
    allowed = _FLOATS if current.is_floating_point() else _INTEGERS
    return value.dtype in allowed and _kind(value) == str(value.dtype)


def _kind(value: Tensor) -> str:
    """Describe a tensor by its dtype, and what makes it no dense tensor."""
    if value.layout is not torch.strided:
        return f"{value.dtype}, {value.layout}"
    if value.is_meta:
        return f"{value.dtype} without data"
    # One number can stand for terabytes.
    expanded = value.numel() * value.element_size() > value.untyped_storage().nbytes()
    return f"{value.dtype}{' with fewer numbers than its shape says' * expanded}"


def _some(parts: Sequence[str], most: int = 6) -> str:
    """List the first few, and the number of others."""
    more = f" and {len(parts) - most} more" * (len(parts) > most)
    return ", ".join(parts[:most]) + more
