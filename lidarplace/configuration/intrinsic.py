"""The intrinsic matrix of a camera, validated."""

import math
from collections.abc import Sequence

from lidarplace.base.errors import InputError

SHAPE = "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]"
WIDEST_DEG, NARROWEST_DEG = 170.0, 0.5
"""Fields of view of pinhole cameras, degrees."""
_MOST_STRETCHED = 2.0  # fx by fy; pixels are nearly square
_HAIR = 1e-9


def check_intrinsic(matrix: Sequence[Sequence[float]], pixels: tuple[int, int] | None) -> None:
    """Raise InputError, with the probable cause, unless a matrix is one of a pinhole camera.

    Its numbers are in pixels; `pixels` are the width and height of the image, where they are known.
    """
    (fx, skew, cx), (across, fy, cy), last = matrix
    if any(last[:2]) and not (cx or cy):
        raise InputError("matrix is transposed", key="intrinsic", expected=SHAPE)
    if any(abs(entry) > _HAIR for entry in (skew, across, last[0], last[1], last[2] - 1)):
        raise InputError(key="intrinsic", expected=SHAPE, found=[list(row) for row in matrix])
    if not min(fx, fy) > 0:
        raise InputError(key="intrinsic", expected="focal lengths > 0, such as [[1260, 0, 800], …]")
    for focal, size in zip((fx, fy), pixels or (), strict=False):
        field = math.degrees(2 * math.atan(0.5 * size / focal))
        if not NARROWEST_DEG <= field <= WIDEST_DEG:
            expected = f"a field of view of {NARROWEST_DEG:g} to {WIDEST_DEG:g} degrees"
            unit = "millimetres; divide by the size of a pixel"
            if max(cx, cy) <= 1:
                unit = "parts of the image; multiply by pixels"
            fix = f"values are probably {unit}" if field > WIDEST_DEG else "use pixels"
            text = f"{field:.4g} by {focal:g} for {size} pixels"
            raise InputError(key="intrinsic", expected=expected, found=text, fix=fix)
    if not 1 / _MOST_STRETCHED <= (ratio := fx / fy) <= _MOST_STRETCHED:
        expected = f"fx / fy of 1 / {_MOST_STRETCHED:g} to {_MOST_STRETCHED:g}"
        raise InputError(key="intrinsic", expected=expected, found=f"{ratio:.3g}")
    if pixels is not None and not (0 < cx < pixels[0] and 0 < cy < pixels[1]):
        expected = f"a principal point within {pixels[0]} x {pixels[1]} pixels"
        raise InputError(key="intrinsic", expected=expected, found=f"{cx:g}, {cy:g}")
