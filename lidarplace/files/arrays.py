"""Arrays from NumPy's files; what is wrong with a file is one line that names it."""

import tokenize
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.files.atomic import reading
from lidarplace.files.regular import regular

_DAMAGED = (ValueError, EOFError, tokenize.TokenError)
"""Errors of NumPy for what is no array; the last for a header taken for an old one."""
_DAMAGED_ZIP = (zipfile.BadZipFile, zlib.error, NotImplementedError, AttributeError, TypeError)


def read_npy(path: Path, dtype: type[np.generic], ndim: int, mapped: bool = False) -> NDArray[Any]:
    """Read the array in a `.npy` file, which stays on the disk until it is used if `mapped`.

    Raises OSError: the file cannot be read; ValueError: no array of that dtype and ndim."""
    try:
        array = np.load(regular(path), mmap_mode="r" if mapped else None, allow_pickle=False)
    except _DAMAGED as error:
        raise InputError(f"not an array of NumPy: {error}", place=path) from None
    if not isinstance(array, np.ndarray) or array.dtype != dtype or array.ndim != ndim:
        raise InputError(place=path, expected=f"{np.dtype(dtype)}, {ndim} axes", found=_kind(array))
    return array


def read_npz(path: Path) -> dict[str, NDArray[Any]]:
    """Read the arrays in a `.npz` file by name, in the order of the file.

    Raises ValueError: the file cannot be read, has another format, or is damaged."""
    with reading(path, "a file of arrays, or a damaged one", *_DAMAGED, *_DAMAGED_ZIP):
        arrays = np.load(regular(path), allow_pickle=False)
        if not isinstance(arrays, np.ndarray):
            with arrays:
                return {name: arrays[name] for name in arrays.files}
    raise InputError(place=path, expected="several arrays by name", found="one")


def _kind(array: Any) -> str:
    return f"{array.dtype}, shape {array.shape}" if isinstance(array, np.ndarray) else "several"
