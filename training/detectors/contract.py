"""What a network returns is what `Detector` documents; one line for what is not."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from lidarplace.base.errors import InputError
from training.detectors.detector import Detector

_COLUMNS = {"boxes": (7,), "scores": (), "labels": (), "refined": (7,)}
_IS_SIZE = np.isin(range(7), (3, 4, 5))


def checked_losses(model: Detector, losses: Mapping[str, Tensor]) -> Mapping[str, Tensor]:
    """Losses of a batch. Raises InputError unless they are single numbers, "loss" with a gradient.

    A number that is not finite is `Optimisation.step`'s to report, which knows the frames.
    """
    place = f"{_name(model)}.loss"
    if not isinstance(losses, Mapping) or not isinstance(losses.get("loss"), Tensor):
        expected = 'a dict with the tensor "loss"'
        raise InputError("no loss", place=place, expected=expected, found=_kind(losses))
    for name, value in losses.items():
        single = value.numel() == 1 if isinstance(value, Tensor) else isinstance(value, int | float)
        if not single:
            kind, expected = _kind(value), "one number"
            raise InputError("wrong shape", place=place, key=name, expected=expected, found=kind)
    if not losses["loss"].requires_grad:
        raise InputError("loss has no gradient", place=place, fix="compute it from the weights")
    return {n: v if isinstance(v, Tensor) else torch.tensor(float(v)) for n, v in losses.items()}


def as_arrays(
    model: Detector, found: Sequence[Mapping[str, Tensor]], frames: Sequence[int]
) -> list[dict[str, NDArray[Any]]]:
    """The detections of `frames` as NumPy arrays.

    Raises:
        InputError: they are not what `Detector.predict` documents; names the network and the frame.
    """
    place = f"{_name(model)}.predict"
    if not isinstance(found, Sequence) or len(found) != len(frames):
        expected = f"a list of {len(frames)} dicts, one per frame"
        raise InputError("wrong result", place=place, expected=expected, found=_kind(found))
    return [
        _frame_arrays(item, f"{place}: frame {number}", len(model.classes))
        for number, item in zip(frames, found, strict=True)
    ]


def _frame_arrays(item: Mapping[str, Tensor], place: str, classes: int) -> dict[str, NDArray[Any]]:
    if not isinstance(item, Mapping) or not {"boxes", "scores", "labels"} <= item.keys():
        expected = "a dict of boxes, scores and labels"
        raise InputError("wrong result", place=place, expected=expected, found=_kind(item))
    arrays: dict[str, NDArray[Any]] = {}
    for name in (name for name in _COLUMNS if name in item):
        value, columns = item[name], _COLUMNS[name]
        shape = tuple(value.shape) if isinstance(value, Tensor) else ()
        rows = shape[0] if columns and shape else len(arrays.get("boxes", ()))
        if shape != (rows, *columns):
            expected, found = "(M, 7)" if columns else f"({rows},)", _kind(value)
            raise InputError("wrong shape", place=place, key=name, expected=expected, found=found)
        array = arrays[name] = value.detach().cpu().double().numpy()
        bad, allowed = ~np.isfinite(array), "finite numbers"
        if name == "labels":
            bad, allowed = ~np.isin(array, range(1, classes + 1)), f"1 to {classes}"
        elif name == "boxes":
            bad, allowed = bad | (array < 0) & _IS_SIZE, "finite numbers, sizes from 0"
        if bad.any():
            row = int(np.argwhere(bad)[0][0])
            key, numbers = f"{name}[{row}]", f"{array[row].tolist()}"
            raise InputError("out of range", place=place, key=key, expected=allowed, found=numbers)
    arrays["labels"] = arrays["labels"].astype(np.int64)
    return arrays


def _name(model: Detector) -> str:
    return f"{type(model).__module__}.{type(model).__qualname__}"


def _kind(value: object) -> str:
    if isinstance(value, Tensor):
        return f"{tuple(value.shape)}"
    parts = f" of {', '.join(map(str, value))}" if isinstance(value, Mapping) else ""
    length = f" of {len(value)}" if isinstance(value, list | tuple) else ""
    return f"{type(value).__name__}{parts or length}"
