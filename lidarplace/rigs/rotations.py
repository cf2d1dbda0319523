"""Rotations of files, checked: quaternions and matrices of a length other than 1 are damaged."""

from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from lidarplace.base.errors import InputError
from lidarplace.base.number_text import percent

MOST_OFF = 0.01  # from length 1: more than float32 and four decimals leave
TILTED, LEVEL = np.cos(np.radians([30, 15]))  # vertical part of a LiDAR's axis


def rotations(quaternions: ArrayLike, row: Callable[[int], str] = lambda n: "") -> Rotation:
    """Return the rotations of quaternions x, y, z, w, (N, 4) or (4,).

    Raises InputError for the first whose length is more than `MOST_OFF` off 1; `row` names its
    row."""
    lengths = np.linalg.norm(np.atleast_2d(quaternions), axis=-1)
    if (wrong := np.flatnonzero(~(np.abs(lengths - 1) <= MOST_OFF))).size:
        length = f"{lengths[wrong[0]]:.6g}"
        problem, fix = "invalid quaternion", "a rotation has length 1, so this one is damaged"
        expected = f"length 1 within {percent(MOST_OFF)}"
        place = row(int(wrong[0]))
        raise InputError(problem, place=place, expected=expected, found=length, fix=fix)
    return Rotation.from_quat(quaternions)


def rotations_of(
    matrices: NDArray[np.float64], row: Callable[[int], str] = lambda n: ""
) -> Rotation:
    """Return the rotations of matrices, (N, 3, 3) or (3, 3).

    Raises InputError for the first whose columns are not of length 1, or not at right angles, by
    more than twice `MOST_OFF`, or that mirrors."""
    each = np.reshape(matrices, (-1, 3, 3))
    off = np.abs(each.transpose(0, 2, 1) @ each - np.eye(3)).max(axis=(1, 2), initial=0.0)
    wrong = np.flatnonzero(~(off <= 2 * MOST_OFF) | ~(np.linalg.det(each) > 0))
    if wrong.size:
        place, expected = row(int(wrong[0])), "columns of length 1 at right angles, right-handed"
        raise InputError("invalid rotation matrix", place=place, expected=expected)
    return Rotation.from_matrix(matrices)


def order_caution(names: Iterable[str], matrices: NDArray[np.float64]) -> list[str]:
    """Caution of tilted LiDARs if all are level once quaternions w, x, y, z are read as x, y, z, w.

    `matrices` are sensor-to-vehicle, (N, 3, 3)."""
    quaternions = Rotation.from_matrix(matrices).as_quat(scalar_first=True)
    upright = Rotation.from_quat(quaternions).as_matrix()[:, 2, 2]
    tilted = [name for name, up in zip(names, matrices[:, 2, 2], strict=True) if up < TILTED]
    if not tilted or not (upright > LEVEL).all():
        return []
    return [
        f"{', '.join(tilted)}: tilted by more than 30 degrees, but all LiDARs are level if "
        "quaternions are x, y, z, w: are they read in the wrong order?"
    ]
