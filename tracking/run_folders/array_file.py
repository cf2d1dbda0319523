"""A file of arrays of a run folder: the writer and the reader go by the same fields."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from lidarplace.files.atomic import replacing

Arrays = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class ArrayFile:
    """A NumPy archive: a field that is an array under its name, those of a mapping as `field/key`,
    and so on inwards."""

    FILE: ClassVar[str]

    def write(self, folder: Path) -> None:
        """Write all arrays in one step."""
        with replacing(folder / self.FILE) as partial, partial.open("wb") as file:
            np.savez_compressed(file, **dict(_flat(vars(self))))  # type: ignore[arg-type]


def _flat(arrays: Mapping[str, Any], start: str = "") -> Iterator[tuple[str, NDArray[Any]]]:
    for name, value in arrays.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{start}{name}/")
        else:
            yield f"{start}{name}", value


def within(arrays: Arrays, field: str) -> dict[str, NDArray[Any]]:
    """Arrays of the field, a mapping, in the order of the file."""
    start = f"{field}/"
    return {name[len(start) :]: arrays[name] for name in arrays if name.startswith(start)}
