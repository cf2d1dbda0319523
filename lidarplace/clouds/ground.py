"""Materials of the ground: asphalt, paving and grass in patches, with road markings.

A box log does not say where roads are. So one square of patches is repeated all over the world:
what lies at a place lies there in every frame and under every placement, and intensities vary as on
a street, but the marks follow no lane."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from lidarplace.clouds.reflectivity import Material, reflectivity

CELL_M = 0.25
CELLS = 256
"""Cells of `CELL_M` along an edge of the square; a power of two."""
_STREAM = 905  # next to the seed, so that nothing else draws the same numbers
_PATCH = 16  # cells along an edge of a patch
_SURFACES = ((Material.ASPHALT, 0.6), (Material.PAVING, 0.25), (Material.GRASS, 0.15))
_LINES, _DASH, _GAP = 4, 12, 20  # marked lines along each axis; cells of a dash, and between dashes


@dataclass(frozen=True)
class Ground:
    """The ground around the vehicle in one frame.

    Attributes:
        reflectivity: of the cells of the square, [y, x], shape (CELLS, CELLS), float32; it
            becomes read-only.
        pose: x, y and yaw of the ego frame in that of the square; metres, radians; finite.
        level: whether the ground is flat, at z = 0."""

    reflectivity: NDArray[np.float32]
    pose: tuple[float, float, float]
    level: bool = True

    def __post_init__(self) -> None:
        self.reflectivity.flags.writeable = False  # as of `square`: numba compiles for one kind


@lru_cache(maxsize=4)
def square(seed: int) -> NDArray[np.float32]:
    """Return the square of patches of a seed; `Ground.reflectivity`."""
    rng = np.random.default_rng([seed % 2**64, _STREAM])
    materials, shares = zip(*_SURFACES, strict=True)
    patches = (CELLS // _PATCH, CELLS // _PATCH)
    patch = reflectivity(rng.choice(materials, patches, p=shares), rng.random(patches))
    cells = np.kron(patch, np.ones((_PATCH, _PATCH)))
    for lines in (cells, cells.T):
        for line in rng.choice(CELLS, _LINES, replace=False):
            for start in range(int(rng.integers(_DASH + _GAP)), CELLS, _DASH + _GAP):
                dash = lines[line, start : start + _DASH]
                dash[:] = reflectivity(np.full(1, Material.MARKING), rng.random(1))
    reflectivities = cells.astype(np.float32)
    reflectivities.flags.writeable = False  # shared by all callers
    return reflectivities
