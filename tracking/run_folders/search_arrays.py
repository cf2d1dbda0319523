"""Arrays of a search's run folder: what of the entropy stays unseen."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from lidarplace.files.arrays import check_numbers, read_npz
from lidarplace.files.regular import is_there
from tracking.run_folders.array_file import ArrayFile, within


@dataclass(frozen=True)
class UnseenMaps(ArrayFile):
    """Entropy of each column of voxels, nats, shape (nx, ny), float32.

    Attributes:
        pog: by class, all of it.
        unseen: by class and rig, that of the voxels which no beam covers.
    """

    FILE: ClassVar[str] = "maps.npz"

    pog: dict[str, NDArray[np.float32]]
    unseen: dict[str, dict[str, NDArray[np.float32]]]

    @classmethod
    def read(cls, folder: Path) -> UnseenMaps:
        """Without any map if they are not in `folder`. Raises ValueError that names file and
        array."""
        path = folder / cls.FILE
        arrays = read_npz(path) if is_there(path) else {}
        for name, array in arrays.items():
            check_numbers(name, array, 2, path)
        pog, unseen = within(arrays, "pog"), within(arrays, "unseen")
        classes = dict.fromkeys(name.partition("/")[0] for name in unseen)
        return cls(pog, {name: within(unseen, name) for name in classes})
