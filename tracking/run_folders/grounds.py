"""The ground around the vehicle under the rigs of a sweep or a search, for pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from lidarplace.files.arrays import check_numbers
from lidarplace.requirements.ground import Ground
from tracking.run_folders.array_file import ArrayFile


@dataclass(frozen=True)
class Grounds(ArrayFile):
    """What every place around the vehicle has of what is required there; see `Ground`.

    Attributes:
        body: `lidarplace.mounting.outline.outline` of the vehicle, metres, shape (n, 2), float64.
        names: the requirements, shape (r,), str.
        x, y: by number of the requirement, middles of cells, metres, shapes (nx,) and (ny,),
            float64.
        least: by that number and the rig, as `0/line`, shape (nx, ny), float32.
    """

    FILE: ClassVar[str] = "requirements.npz"

    body: NDArray[np.float64]
    names: NDArray[np.str_]
    x: dict[str, NDArray[np.float64]]
    y: dict[str, NDArray[np.float64]]
    least: dict[str, NDArray[np.float32]]

    @classmethod
    def of(
        cls, body: NDArray[np.float64], names: Sequence[str], by_rig: Mapping[str, Sequence[Ground]]
    ) -> Grounds:
        """Those of each rig, in the order of the requirements' `names`."""
        found = cls(body, np.array(names), {}, {}, {})
        for rig, grounds in by_rig.items():
            for number, ground in enumerate(grounds):
                found.x[str(number)], found.y[str(number)] = ground.x, ground.y
                found.least[f"{number}/{rig}"] = ground.least.astype(np.float32)
        return found

    def under(self, rig: str, requirement: str) -> Ground | None:
        """The ground of a requirement under a rig; None if it is not kept."""
        names = self.names.tolist()
        number = str(names.index(requirement)) if requirement in names else ""
        least = self.least.get(f"{number}/{rig}")
        if least is None:
            return None
        return Ground(self.x[number], self.y[number], least.astype(np.float64))

    def _check(self, path: Path) -> None:
        check_numbers("body", self.body, 2, path)
        if self.body.shape[1:] != (2,):
            raise ValueError(f"{path}: body needs x and y of each corner, found {self.body.shape}")
        if self.names.ndim != 1 or self.names.dtype.kind != "U":
            raise ValueError(f"{path}: names must hold text, found {self.names.dtype}")
        for number in map(str, range(len(self.names))):
            for field in ("x", "y"):
                own = getattr(self, field)
                if number not in own:
                    raise ValueError(f"{path} has no array {field}/{number}")
                check_numbers(f"{field}/{number}", own[number], 1, path)
        for name, least in self.least.items():
            check_numbers(f"least/{name}", least, 2, path)
            number = name.partition("/")[0]
            if number not in self.x or least.shape != (len(self.x[number]), len(self.y[number])):
                raise ValueError(f"{path}: least/{name} is no grid of x and y, its {least.shape}")
