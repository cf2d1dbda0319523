"""Clouds that were recorded, not simulated: folders that hold the frames of one placement."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lidarplace.lidar.clouds import Crop, PointClouds, read_clouds

_BEGINNING = 256
"""Bytes of a packed frame that tell it from another one."""


def recorded_clouds(folder: Path, frames: NDArray[np.int64], crop: Crop) -> PointClouds:
    """The clouds of `frames` within `crop`, its faces included.

    Args:
        folder: of one placement; each folder in it is of `lidarplace.lidar.clouds.write_clouds`.
        frames: frame numbers, shape (F,).
        crop: what is kept.

    Raises:
        ValueError: there is no such folder, or a frame is missing.
    """
    parts = [read_clouds(path) for path in _parts(folder)]
    place = {int(f): (part, i) for part in parts for i, f in enumerate(part.frames)}
    missing = [frame for frame in frames.tolist() if frame not in place]
    if missing:
        raise ValueError(
            f"{folder}: no cloud of frame {missing[0]}, and of {len(missing) - 1} more"
        )
    low, high = np.array(crop[:3]), np.array(crop[3:])

    def cut() -> Iterator[tuple[NDArray[np.float32], NDArray[np.int64]]]:
        for frame in frames.tolist():
            part, index = place[frame]
            points = part[index]
            inside = ((points[:, :3] >= low) & (points[:, :3] <= high)).all(axis=1)
            lidars = part.counts.shape[1]
            yield points[inside], np.bincount(part.lidar(index)[inside], minlength=lidars)

    return PointClouds.from_frames(frames, cut(), crop)


def clouds_digest(folder: Path) -> str:
    """Hash of the clouds in `folder`: their frames, and length and beginning of each.

    Not of every byte: a study has a hundred gigabytes of clouds.

    Raises:
        ValueError: there is no such folder.
    """
    digest = hashlib.sha256()
    for path in _parts(folder):
        clouds = read_clouds(path)
        digest.update(path.name.encode() + clouds.frames.tobytes() + clouds.offsets.tobytes())
        for first, end in pairwise(clouds.offsets.tolist()):
            digest.update(clouds.data[first : min(first + _BEGINNING, end)].tobytes())
    return digest.hexdigest()


def _parts(folder: Path) -> list[Path]:
    parts = sorted(path.parent for path in folder.glob("*/data.npy"))
    if not parts:
        raise ValueError(f"{folder}: no recorded clouds")
    return parts
