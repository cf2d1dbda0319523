"""A file of arrays of a run folder: the writer and the reader go by the same fields."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from lidarplace.files.arrays import read_npz
from lidarplace.files.atomic import replacing
from lidarplace.files.regular import is_there

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

    @classmethod
    def read(cls, folder: Path) -> Self | None:
        """None if it is not in `folder`. Raises ValueError that names file and array."""
        path = folder / cls.FILE
        if not is_there(path):
            return None
        arrays = read_npz(path)
        found = {
            field.name: within(arrays, field.name)
            if str(field.type).startswith("dict")
            else arrays.get(field.name)
            for field in fields(cls)
        }
        if missing := [name for name, value in found.items() if value is None]:
            raise ValueError(f"{path} has no array {', '.join(missing)}; found {', '.join(arrays)}")
        whole = cls(**found)
        whole._check(path)
        return whole

    def _check(self, path: Path) -> None:
        """Raise ValueError unless the arrays are of the shapes that the class tells."""
        raise NotImplementedError


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
