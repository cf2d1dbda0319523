"""The point clouds of many frames, packed: about 2.3 bytes a point, read back one frame at a time.

Points come in the order of the rays, so neighbours differ little. A frame is stored as differences
between successive points, on a grid of a millimetre, their bytes sorted by significance and
compressed with zstd. Plain arrays hold all of it: they are mapped from disk, and no process
copies."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import accumulate
from pathlib import Path
from typing import Generic, Protocol, TypeVar

import numpy as np
import pyarrow as pa
from numpy.typing import ArrayLike, NDArray

from lidarplace.base.errors import InputError
from lidarplace.base.kernel_cache import njit
from lidarplace.files.arrays import read_npy
from lidarplace.files.atomic import replacing

Crop = tuple[float, float, float, float, float, float]
"""A region: x0, y0, z0, x1, y1, z1, metres."""
STEP_M = 0.001
"""Grid on which points lie; coarser where the region is wider than 65.535 m."""
_LEVEL = 1  # of zstd: higher ones cost ten times as long for 4 % fewer bytes
_BYTES = 7  # of a point before compression: three coordinates and an intensity


@dataclass(frozen=True)
class PointClouds:
    """Merged clouds of all LiDARs, frame after frame, in the ego frame.

    `clouds[i]` unpacks the points of the i-th frame: x, y, z in metres and intensity in [0, 1],
    shape (n, 4), float32. Coordinates are exact to half of `step`, intensities to 1/510. The points
    of a frame are sorted by LiDAR and, within it, by ray.

    Attributes:
        data: the packed frames, shape (bytes,), uint8.
        offsets: the i-th frame is `data[offsets[i]:offsets[i + 1]]`, shape (F + 1,), int64.
        counts: points of every LiDAR in every frame, shape (F, LiDARs), int32.
        frames: frame numbers of the box log, shape (F,), int64.
        crop: region that was kept, shape (6,), float64, metres; its lower corner is that of the
            grid of coordinates.
        step: of that grid, metres, shape (), float64."""

    data: NDArray[np.uint8]
    offsets: NDArray[np.int64]
    counts: NDArray[np.int32]
    frames: NDArray[np.int64]
    crop: NDArray[np.float64]
    step: NDArray[np.float64]

    def __repr__(self) -> str:
        frames, lidars = self.counts.shape
        return (
            f"PointClouds({frames:,} frames, {lidars} LiDARs, {self.counts.sum():,} points, "
            f"{self.data.nbytes / 1e6:.3g} MB)"
        )

    @classmethod
    def from_frames(
        cls, frames: ArrayLike, clouds: Iterable[tuple[NDArray[np.float32], ArrayLike]], crop: Crop
    ) -> PointClouds:
        """Pack clouds, one frame at a time.

        Of each of `frames`, numbers (F,), `clouds` has its points (n, 4), sorted by LiDAR, and the
        number of points of every LiDAR (LiDARs,). The region `crop`, to which the clouds were cut,
        decides the grid. Raises ValueError: a point is not on the grid or not finite, or numbers do
        not fit together."""
        numbers = np.asarray(frames, np.int64)
        origin = np.array(crop[:3])
        step = grid_step(crop)
        codec = pa.Codec("zstd", compression_level=_LEVEL)
        packed, ends = bytearray(), [0]
        counts = []
        for points, of_lidars in clouds:
            count = np.asarray(of_lidars, np.int32)
            if count.sum() != len(points):
                raise ValueError(f"{len(points)} points, but {count.sum()} of the LiDARs together")
            planes = np.empty(_BYTES * len(points), np.uint8)
            values = np.ascontiguousarray(points, np.float32)
            bad = _pack(values, origin.astype(np.float64), step, planes)
            if bad >= 0:
                span = f"from {origin.tolist()} to {(origin + 65535 * step).tolist()}"
                expected, faulty = f"coordinates {span}, intensity in [0, 1]", points[bad].tolist()
                raise InputError(place=f"point {bad} of a cloud", expected=expected, found=faulty)
            packed += codec.compress(planes, asbytes=True)
            ends.append(len(packed))
            counts.append(count)
        if len(counts) != len(numbers):
            raise ValueError(f"{len(numbers)} frame numbers for {len(counts)} clouds")
        data, offsets = np.frombuffer(packed, np.uint8), np.array(ends, np.int64)
        table = np.stack(counts) if counts else np.empty((0, 0), np.int32)
        return cls(data, offsets, table, numbers, np.array(crop, np.float64), np.array(step))

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, index: int) -> NDArray[np.float32]:
        """Return the points of the `index`-th frame, shape (n, 4), float32, the caller's own."""
        if not 0 <= index < len(self):
            raise IndexError(f"frame index {index} outside 0..{len(self) - 1}")
        count = int(self.counts[index].sum())
        codec = pa.Codec("zstd", compression_level=_LEVEL)
        packed = self.data[self.offsets[index] : self.offsets[index + 1]]
        planes = codec.decompress(packed, decompressed_size=_BYTES * count)
        points = np.empty((count, 4), np.float32)
        _unpack(np.frombuffer(planes, np.uint8), self.crop[:3], float(self.step), points)
        return points

    def __iter__(self) -> Iterator[NDArray[np.float32]]:
        return (self[i] for i in range(len(self)))

    def lidar(self, index: int) -> NDArray[np.uint8]:
        """Return the number of the mount of each point of a frame, shape (n,), uint8."""
        mounts = np.arange(self.counts.shape[1], dtype=np.uint8)
        return np.repeat(mounts, self.counts[index])

    def arrays(self) -> dict[str, np.ndarray]:
        """Return the attributes by name, for a file or another process."""
        return {item.name: getattr(self, item.name) for item in fields(PointClouds)}


class CloudFrames(Protocol):
    """Interface of clouds that are read frame by frame, stored or simulated, as detectors do."""

    @property
    def frames(self) -> NDArray[np.int64]:
        """Frame numbers, shape (F,), int64."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int, /) -> NDArray[np.float32]:
        """Return x, y, z, intensity of the `index`-th frame, shape (n, 4), the caller's own."""


Part = TypeVar("Part", bound=CloudFrames)


@dataclass(frozen=True)
class JoinedClouds(Generic[Part]):
    """Several clouds, stored or not, one after the other, without a copy."""

    parts: Sequence[Part]

    @property
    def frames(self) -> NDArray[np.int64]:
        """Frame numbers of all parts, shape (F,), int64."""
        return np.concatenate([np.empty(0, np.int64), *(part.frames for part in self.parts)])

    @cached_property
    def _ends(self) -> list[int]:
        """Number of frames up to the end of each part."""
        return list(accumulate(map(len, self.parts)))

    def __len__(self) -> int:
        return self._ends[-1] if self._ends else 0

    def __getitem__(self, index: int) -> NDArray[np.float32]:
        """Return the points of the `index`-th frame, shape (n, 4), float32."""
        part, place = self.part(index)
        return part[place]

    def part(self, index: int) -> tuple[Part, int]:
        """Return the part that holds the `index`-th frame, and its index in that part."""
        if not 0 <= index < len(self):
            raise IndexError(f"frame index {index} is not one of {len(self)} frames")
        number = bisect_right(self._ends, index)
        part = self.parts[number]
        return part, index - self._ends[number] + len(part)

    def __iter__(self) -> Iterator[NDArray[np.float32]]:
        return (self[i] for i in range(len(self)))


Clouds = PointClouds | JoinedClouds[PointClouds]
"""Clouds that detectors can be trained on."""


def as_kept(points: NDArray[np.float32], crop: Crop) -> NDArray[np.float32]:
    """Return points (n, 4) in `crop` as `PointClouds` would give them back, to the last bit."""
    rounded = np.empty_like(points)
    _round(points, np.array(crop[:3], np.float64), grid_step(crop), rounded)
    return rounded


def grid_step(crop: Crop) -> float:
    """Return the step of the grid of a region, metres."""
    return max(STEP_M, float((np.array(crop[3:]) - np.array(crop[:3])).max()) / 65535)


def write_clouds(folder: Path, clouds: PointClouds) -> None:
    """Write one `.npy` file an attribute into `folder`, each renamed into place."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, array in clouds.arrays().items():
        with replacing(folder / f"{name}.npy") as partial, partial.open("wb") as file:
            np.save(file, array, allow_pickle=False)


def read_clouds(folder: Path) -> PointClouds:
    """Read what `write_clouds` wrote; the packed frames stay on disk until they are asked for.

    Raises OSError for a missing file, ValueError if the arrays do not fit together."""
    kinds = _ARRAYS.items()
    arrays = {n: read_npy(folder / f"{n}.npy", *kind, mapped=n == "data") for n, kind in kinds}
    clouds = PointClouds(**arrays)
    frames, offsets = len(clouds.frames), clouds.offsets
    rising = len(offsets) > 0 and offsets[0] == 0 and bool((np.diff(offsets) >= 0).all())
    fits = {
        "offsets": len(offsets) == frames + 1 and rising,
        "data": len(offsets) > 0 and len(clouds.data) == offsets[-1],
        "counts": len(clouds.counts) == frames and bool((clouds.counts >= 0).all()),
        "crop": len(clouds.crop) == 6 and bool(np.isfinite(clouds.crop).all()),
        "step": 0 < clouds.step < np.inf,
    }
    for name, good in fits.items():
        if not good:
            shape = getattr(clouds, name).shape
            wrong = f"does not fit the other arrays of {frames} frames, or has wrong values"
            raise InputError(f"shape {shape} {wrong}", place=f"{folder / name}.npy")
    return clouds


_ARRAYS: dict[str, tuple[type[np.generic], int]] = {
    "data": (np.uint8, 1),
    "offsets": (np.int64, 1),
    "counts": (np.int32, 2),
    "frames": (np.int64, 1),
    "crop": (np.float64, 1),
    "step": (np.float64, 0),
}
"""Type and number of axes of every attribute of `PointClouds`."""


@njit(cache=True)
def _pack(points, origin, step, planes):
    """Fill the planes of bytes; return the first point that does not fit, or -1.

    For each coordinate the low bytes of all points, then the high bytes; last the intensities. A
    difference d of 16 bits, seen as signed, is folded to 2 d or -2 d - 1, so small ones of either
    sign have a high byte of 0."""
    count = len(points)
    for axis in range(3):
        before = np.uint16(0)
        for n in range(count):
            value = np.floor((points[n, axis] - origin[axis]) / step + 0.5)
            if not 0 <= value <= 65535:  # True for NaN
                return n
            now = np.uint16(value)
            change = np.int16(np.uint16(now - before))
            before = now
            folded = np.uint16((np.int32(change) << 1) ^ (np.int32(change) >> 15))
            planes[2 * axis * count + n] = folded & 255
            planes[(2 * axis + 1) * count + n] = folded >> 8
    last = np.uint8(0)
    for n in range(count):
        if not 0 <= points[n, 3] <= 1:
            return n
        intensity = np.uint8(np.floor(255 * points[n, 3] + 0.5))
        planes[6 * count + n] = np.uint8(intensity - last)
        last = intensity
    return -1


@njit(cache=True)
def _unpack(planes, origin, step, points):
    """Fill points from the planes of `_pack`."""
    count = len(points)
    for axis in range(3):
        low, high = 2 * axis * count, (2 * axis + 1) * count
        value = np.int32(0)
        for n in range(count):
            folded = np.int32(planes[low + n]) | (np.int32(planes[high + n]) << 8)
            value = (value + ((folded >> 1) ^ -(folded & 1))) & 65535
            points[n, axis] = origin[axis] + step * value
    intensity = np.int32(0)
    for n in range(count):
        intensity = (intensity + planes[6 * count + n]) & 255
        points[n, 3] = intensity / 255


@njit(cache=True, error_model="numpy")
def _round(points, origin, step, rounded):
    """Round points to the grid, as `_pack` and `_unpack` do."""
    for n in range(len(points)):
        for axis in range(3):
            value = np.floor((points[n, axis] - origin[axis]) / step + 0.5)
            rounded[n, axis] = origin[axis] + step * value
        rounded[n, 3] = np.floor(255 * points[n, 3] + 0.5) / 255
