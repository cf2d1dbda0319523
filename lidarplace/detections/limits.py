"""Limits of what a detection can be, whoever made it: a file, or a network in this process."""

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.logs.plausible import MOST_YAW, SIZES

COLUMNS = (*GEOMETRY, "score")


def first_invalid(values: NDArray[np.float64]) -> tuple[int, str, str] | None:
    """Return row, column and expected value of the first invalid number, None if there is none.

    `values` are `GEOMETRY` and, if there are 8 columns, the score; shape (n, 7) or (n, 8)."""
    for start, bad, expected in (
        (0, ~np.isfinite(values), "a finite number"),
        (3, values[:, 3:6] <= 0, "more than 0 m"),
        (6, np.abs(values[:, 6:7]) > MOST_YAW, "radians, at most two turns"),
    ):
        if bad.any():
            row, column = np.argwhere(bad)[0].tolist()
            return row, COLUMNS[start + column], expected
    return None


def check_unit(sizes: NDArray[np.float64]) -> None:
    """Raise InputError if sizes, (n, 3), are in centimetres or millimetres: by their median, as
    a network that is not trained yet finds single boxes of any size."""
    if len(sizes) and (longest := float(np.median(sizes.max(axis=1)))) > SIZES[0]:
        expected = f"metres, a median longest side of at most {SIZES[0]:g} m"
        raise InputError("wrong unit", key="sizes", expected=expected, found=f"{longest:g}")
