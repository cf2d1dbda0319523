"""Checks of what a network returns, as `Detector` documents it; one line for each fault."""

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray
from torch import Tensor

from lidarplace.base.errors import InputError, at
from lidarplace.base.foreign_code import foreign_code
from lidarplace.logs.boxes import GEOMETRY, SIZE
from lidarplace.logs.plausibility import check_unit, first_invalid
from training.detectors.detector import Detector

_COLUMNS = {"boxes": (7,), "scores": (), "labels": (), "refined": (7,)}


def is_built_in(model: Detector) -> bool:
    """Test if the class of the network is of this package."""
    return type(model).__module__.startswith("training.")


def guarded(model: Detector) -> AbstractContextManager[None]:
    """Guard a block that calls the network, see `foreign_code`; its exceptions stay as they are."""
    return nullcontext() if is_built_in(model) else foreign_code(_name(model), (Exception,))


def checked_losses(model: Detector, losses: Mapping[str, Tensor]) -> Mapping[str, Tensor]:
    """Check the losses of a batch: single numbers, "loss" with a gradient. Raises InputError.

    A number that is not finite is `Optimisation.step`'s to report, which knows the frames."""
    with at(f"{_name(model)}.loss"):
        if not isinstance(losses, Mapping) or not isinstance(losses.get("loss"), Tensor):
            raise InputError(expected='a dict with the tensor "loss"', found=_kind(losses))
        for name, value in losses.items():
            size = value.numel() if isinstance(value, Tensor) else isinstance(value, int | float)
            if size != 1:
                raise InputError(key=name, expected="one number", found=_kind(value))
        if not losses["loss"].requires_grad:
            raise InputError("no gradient", key="loss", fix="compute it from the weights")
    return {n: v if isinstance(v, Tensor) else torch.tensor(float(v)) for n, v in losses.items()}


def as_arrays(
    model: Detector, detections: Sequence[Mapping[str, Tensor]], frames: Sequence[int]
) -> list[dict[str, NDArray[Any]]]:
    """Convert the detections of `frames` to NumPy arrays.

    Raises:
        InputError: they are not what `Detector.predict` documents; names the network and the frame.
    """
    with at(f"{_name(model)}.predict"):
        if not isinstance(detections, Sequence) or len(detections) != len(frames):
            wanted = f"a list of {len(frames)} dicts, one per frame"
            raise InputError(expected=wanted, found=_kind(detections))
        tensors = []
        for number, item in zip(frames, detections, strict=True):
            with at(f"frame {number}"):
                tensors.append(_frame_tensors(item))
        # One copy from a GPU.
        parts = [
            part.detach().to(model.device, torch.float64).flatten()
            for of_frame in tensors
            for part in of_frame.values()
        ]
        numbers = iter(torch.cat(parts).cpu().split([len(part) for part in parts]))
        arrays = []
        for number, of_frame in zip(frames, tensors, strict=True):
            values = {n: next(numbers).view(part.shape).numpy() for n, part in of_frame.items()}
            with at(f"frame {number}"):
                _check_values(values, len(model.classes))
            arrays.append(values | {"labels": values["labels"].astype(np.int64)})
    return arrays


def check_boxes_of(model: Detector, boxes: pd.DataFrame) -> None:
    """Raise InputError if the boxes of a network from elsewhere are in another unit than metres."""
    if not is_built_in(model):
        with at(f"{_name(model)}.predict"):
            check_unit(boxes[list(SIZE)].to_numpy(np.float64))


def _frame_tensors(item: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Tensors of a frame's detections, whose shapes are checked."""
    if not isinstance(item, Mapping) or not {"boxes", "scores", "labels"} <= item.keys():
        raise InputError(expected="a dict of boxes, scores and labels", found=_kind(item))
    tensors: dict[str, Tensor] = {}
    for name in (name for name in _COLUMNS if name in item):
        value, columns = item[name], _COLUMNS[name]
        shape = tuple(value.shape) if isinstance(value, Tensor) else ()
        rows = shape[0] if columns and shape else len(tensors.get("boxes", ()))
        if shape != (rows, *columns):
            expected = "(M, 7)" if columns else f"({rows},)"
            raise InputError("wrong shape", key=name, expected=expected, found=_kind(value))
        tensors[name] = value
    return tensors


def _check_values(arrays: Mapping[str, NDArray[np.float64]], classes: int) -> None:
    """Check the numbers of a frame's detections."""
    for name, array in arrays.items():
        if name == "boxes" and (invalid := first_invalid(array)) is not None:
            row, column, allowed = invalid
            key, number = f"boxes[{row}]: {column}", array[row, GEOMETRY.index(column)]
            raise InputError(key=key, expected=allowed, found=f"{number:g}")
        bad, allowed = ~np.isfinite(array), "finite numbers"
        if name == "labels":
            bad, allowed = ~np.isin(array, range(1, classes + 1)), f"1 to {classes}"
        if bad.any():
            row = int(np.argwhere(bad)[0][0])
            raise InputError(key=f"{name}[{row}]", expected=allowed, found=array[row].tolist())


def _name(model: Detector) -> str:
    return f"{type(model).__module__}.{type(model).__qualname__}"


def _kind(value: object) -> str:
    if isinstance(value, Tensor):
        return f"{tuple(value.shape)}"
    parts = f" of {', '.join(map(str, value))}" if isinstance(value, Mapping) else ""
    length = f" of {len(value)}" if isinstance(value, list | tuple) else ""
    return f"{type(value).__name__}{parts or length}"
