"""Wrong arrays: `.npz` and `.npy` with other names, shapes and types."""

from pathlib import Path
from random import Random

import numpy as np
from numpy.typing import NDArray

from tests.fuzz.nasty import number


def _other(array: NDArray, random: Random) -> tuple[NDArray, str]:
    """The array made wrong, and how."""
    flat = array.reshape(-1)
    ways = {
        "text": lambda: flat.astype(str),
        "complex": lambda: (
            flat.astype(np.complex128) if flat.dtype.kind in "biuf" else flat.astype(str)
        ),
        "objects": lambda: np.array([{"a": 1}, None], dtype=object),
        "flat": lambda: flat,
        "empty": lambda: flat[:0],
        "a scalar": lambda: np.array(1.0),
        "one axis more": lambda: array[None],
        "cut": lambda: array[: len(array) // 2] if array.ndim else array[None],
        "times": lambda: np.zeros(array.shape, "datetime64[s]"),
        "wrong numbers": lambda: np.full(array.shape, number(random), np.float64),
    }
    name = random.choice(list(ways))
    return ways[name](), name


def npz(path: Path, random: Random) -> str:
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    name = random.choice(list(arrays))
    change = random.choice(("changed", "changed", "changed", "left out", "renamed"))
    if change == "changed":
        arrays[name], change = _other(arrays[name], random)
    else:
        taken = arrays.pop(name)
        if change == "renamed":
            arrays[random.choice(("x", "pog", "pog/", "points/nobody"))] = taken
    np.savez(path, **arrays)
    return f"{name}: {change}"


def npy(path: Path, random: Random) -> str:
    array, change = _other(np.load(path), random)
    np.save(path, array)
    return change
