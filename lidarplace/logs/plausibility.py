"""Plausibility of boxes: the limits and rules that logs, label tables and detections share."""

import math
from collections.abc import Iterable, Iterator
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from lidarplace.base.errors import InputError
from lidarplace.base.number_text import number, percent
from lidarplace.logs.boxes import GEOMETRY, SIZE, first
from lidarplace.logs.convention import Convention

MOST_SIZE_M = 50.0  # hardly a vehicle is so long; 4.5 m in centimetres is more
MOST_YAW = 4 * math.pi
"""A yaw that was unwrapped may pass a turn; most directions in degrees are more."""
SIZES = (30.0, 1000.0)  # median longest side from which a box is in centimetres, and in millimetres
STEP_S = (0.008, 15.0)  # from one labelled frame to the next, in the median

LogCheck = Literal["yaw", "axes", "size", "place", "ground", "time", "poses", "duplicates", "split"]
"""Subject of a check of a box log; a mapping of columns may accept its values as they are."""
DetectionCheck = Literal[
    "rows", "place", "yaw", "size", "ground", "time", "class", "score", "overlap"
]
"""Subject of a check of detections, which may be accepted as it is."""
CHECKS_OF_FRAMES = ("poses", "time")  # checks of a log whose rows are frames


class ImplausibleValue(NamedTuple):
    """Values of a box log or of detections that look like another unit or convention."""

    check: LogCheck | DetectionCheck
    column: str  # the first of several
    problem: str
    remedy: str  # what corrects the values, such as the keys of a mapping
    certain: bool  # whether no real data looks like this, so that it is an error
    rows: NDArray[np.bool_] | None = None
    """Mask of the log's boxes, or of its frames for `CHECKS_OF_FRAMES`; at least one is true."""
    convention: Convention | None = None  # in which the numbers are plausible

    def where(self, boxes: pd.DataFrame) -> str:
        """Count the rows of these boxes (or frames), and show the first with its values."""
        assert self.rows is not None
        kind = "frames" if self.check in CHECKS_OF_FRAMES else "boxes"
        box = boxes[self.rows].iloc[0]
        value = number(box[self.column])
        if self.check == "size":
            value = " x ".join(number(box[side]) for side in SIZE)
        elif self.check in ("place", "axes", "duplicates", "split"):
            value = f"x {number(box['x'])}, y {number(box['y'])}"
        share = percent(self.rows.mean(), ".1f")
        return (
            f"{self.rows.sum():,} of {len(boxes):,} {kind} ({share}), the first in frame "
            f"{box['frame']} with {value}"
        )


def cautions_of(errors: Iterable[tuple[ImplausibleValue, InputError]]) -> list[str]:
    """Return the errors as cautions, the first of each check; raise the first certain one."""
    cautions: dict[str, str] = {}
    for value, error in errors:
        if value.certain:
            raise error
        cautions.setdefault(value.check, str(error))
    return [*cautions.values()]


def over_two_turns(yaw: ArrayLike) -> NDArray[np.bool_]:
    """Return a mask of the yaws that are in degrees rather than radians; shape of `yaw`."""
    return np.abs(np.asarray(yaw, np.float64)) > MOST_YAW


def implausible_boxes(boxes: pd.DataFrame) -> Iterator[str]:
    """Describe the boxes (finite `GEOMETRY`) that look like another unit, and their share."""
    sizes = boxes[list(SIZE)].to_numpy(np.float64)
    too_large = (sizes > MOST_SIZE_M).any(axis=1)
    longest = np.median(sizes[too_large].max(axis=1)) if too_large.any() else 0.0
    unit = "centimetres" if longest < SIZES[1] else "millimetres"
    for rows, problem, hint in (
        (too_large, f"larger than {MOST_SIZE_M:g} m", f"sizes are metres; are these {unit}?"),
        (
            over_two_turns(boxes["yaw"]),
            "turned by more than two turns",
            "yaw is in radians; are these degrees?",
        ),
    ):
        if rows.any():
            yield (
                f"{rows.sum():,} of {len(boxes):,} boxes ({percent(rows.mean())}) are {problem}, "
                f"the first in row {int(rows.argmax())}: {hint}"
            )


def check_yaw(yaw: pd.Series, source: str) -> None:
    """Raise ValueError if a finite yaw is over two turns: it is in degrees, or nonsense."""
    if (row := first(over_two_turns(yaw))) is not None:
        place, key, value = f"{source}: row {row}", str(yaw.name), f"{yaw.iloc[row]:g}"
        expected, fix = "radians, at most two turns", "numpy.radians converts degrees"
        raise InputError(place=place, key=key, expected=expected, found=value, fix=fix)


def first_invalid(values: NDArray[np.float64]) -> tuple[int, str, str] | None:
    """Return row, column and expected value of the first invalid number, None if there is none.

    `values` are `GEOMETRY` and, if there are 8 columns, the score; shape (n, 7) or (n, 8)."""
    for start, invalid, expected in (
        (0, ~np.isfinite(values), "a finite number"),
        (3, values[:, 3:6] <= 0, "more than 0 m"),
        (6, over_two_turns(values[:, 6:7]), "radians, at most two turns"),
    ):
        if invalid.any():
            row, column = np.argwhere(invalid)[0].tolist()
            return row, (*GEOMETRY, "score")[start + column], expected
    return None


def check_unit(sizes: NDArray[np.float64]) -> None:
    """Raise InputError if sizes, (n, 3), are in centimetres or millimetres.

    Their median decides, as a network that is not trained yet predicts single boxes of any size."""
    if len(sizes) and (longest := float(np.median(sizes.max(axis=1)))) > SIZES[0]:
        expected = f"metres, a median longest side of at most {SIZES[0]:g} m"
        raise InputError("wrong unit", key="sizes", expected=expected, found=f"{longest:g}")
