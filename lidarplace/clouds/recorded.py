"""Clouds that were recorded, not simulated: folders that hold the frames of one placement."""

import hashlib
import reprlib
from collections.abc import Iterator, Sequence
from dataclasses import asdict, astuple, fields
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, model_validator

from lidarplace.base.errors import InputError
from lidarplace.clouds.clouds import Crop, PointClouds, read_clouds
from lidarplace.configuration.record import read_record
from lidarplace.files.regular import is_there
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement
from lidarplace.rigs.recorded import RecordedRig


def rig_record(placement: Placement) -> dict[str, object]:
    """Return the record of a placement, `placement.json` next to recorded clouds."""
    lidars = [asdict(lidar) for lidar in placement.lidars]
    for record in lidars:
        if record["correction"] is None:  # as in folders from before there were corrections
            del record["correction"]
    return {"mounts": [asdict(mount) for mount in placement.mounts], "lidars": lidars}


def check_rig(folder: Path, placement: Placement) -> None:
    """Raise ValueError if `placement.json` in `folder` has no rig or another than `placement`.

    A folder without that file is taken at its word."""
    path = folder / "placement.json"
    if not is_there(path):
        return
    recorded = read_record(path, _Rig, "record of a rig")
    mounts, expected_mounts = (
        [astuple(mount) for mount in rig.mounts] for rig in (recorded, placement)
    )
    if len(mounts) != len(expected_mounts) or not np.allclose(
        mounts, expected_mounts, rtol=0, atol=1e-9
    ):
        raise InputError(f"clouds of other mounts than those of {placement.name}", place=path)
    for n, (model, lidar) in enumerate(zip(recorded.models, placement.lidars, strict=True)):
        for key in (item.name for item in fields(lidar)):
            # What it hid of others and what it lost was recorded, whatever is known of it.
            if key in ("size", "correction"):
                continue
            recorded_value, value = getattr(model, key), getattr(lidar, key)
            if not _alike(recorded_value, value):
                where, was = f"lidars[{n}].{key}", reprlib.repr(recorded_value)
                raise InputError(place=path, key=where, expected=reprlib.repr(value), found=was)


def _alike(one: Any, other: Any) -> bool:
    """Return whether both are unknown, or numbers or rows of them that are equal up to rounding."""
    if one is None or other is None:
        return one is other
    return np.shape(one) == np.shape(other) and np.allclose(one, other, rtol=0, atol=1e-9)


class _Rig(BaseModel):
    """`rig_record` as it was written. A rig of one model may be recorded once, as `lidar`."""

    mounts: list[Mount]
    lidars: list[Lidar] | None = None
    lidar: Lidar | None = None

    @property
    def models(self) -> list[Lidar]:
        """The LiDAR of every mount."""
        if self.lidars is not None:
            return self.lidars
        return [] if self.lidar is None else [self.lidar] * len(self.mounts)

    @model_validator(mode="after")
    def _a_lidar_each(self) -> Self:
        if len(self.models) != len(self.mounts):
            raise ValueError(f"{len(self.models)} lidars for {len(self.mounts)} mounts")
        return self


def check_lidars(
    folder: Path, rig: RecordedRig, names: Sequence[str], frames: NDArray[np.int64]
) -> None:
    """Raise ValueError unless recorded clouds are complete.

    The clouds in `folder` must be of `rig`, have points of each LiDAR of `names`, and one cloud for
    each of `frames`, (F,)."""
    points = np.zeros(len(rig.names), np.int64)
    missing = set(frames.tolist())
    for path in _parts(folder):
        clouds = read_clouds(path)
        missing -= set(clouds.frames.tolist())
        counts = clouds.counts
        if counts.shape[1] != len(rig.names):
            wrong, expected = f"points of {counts.shape[1]} LiDARs", ", ".join(rig.names)
            fix = "convert the log from clouds with a column lidar"
            raise InputError(wrong, place=path, expected=f"{len(rig.names)}, {expected}", fix=fix)
        points += counts.sum(axis=0)
    for name, count in zip(rig.names, points.tolist(), strict=True):
        if name in names and count == 0:
            raise InputError(f"no point of LiDAR {name} in any cloud", place=folder)
    if missing:
        raise _no_cloud(folder, sorted(missing))


def recorded_clouds(
    folder: Path, frames: NDArray[np.int64], crop: Crop, lidars: Sequence[int] | None = None
) -> PointClouds:
    """Read the clouds of `frames` (F,) within `crop`, its faces included.

    `folder` is of one placement, each folder in it of `lidarplace.clouds.clouds.write_clouds`.
    Points are those of `lidars`, by their place in the counts, ascending; None: all. Raises
    ValueError: the folder is missing, a frame is missing or duplicate, or less than `crop` was
    recorded."""
    place: dict[int, tuple[PointClouds, int]] = {}
    for path in _parts(folder):
        part = read_clouds(path)
        if not ((part.crop[:3] <= crop[:3]).all() and (part.crop[3:] >= crop[3:]).all()):
            least = f"clouds of at least {list(crop)}"
            raise InputError(place=path, expected=least, found=part.crop.tolist())
        for index, frame in enumerate(part.frames.tolist()):
            if frame in place:
                raise InputError(f"frame {frame} is in another folder of {folder} too", place=path)
            place[frame] = part, index
    missing = [frame for frame in frames.tolist() if frame not in place]
    if missing:
        raise _no_cloud(folder, missing)
    low, high = np.array(crop[:3]), np.array(crop[3:])

    def cut() -> Iterator[tuple[NDArray[np.float32], NDArray[np.int64]]]:
        for frame in frames.tolist():
            part, index = place[frame]
            try:
                points = part[index]
            except (OSError, ValueError) as error:  # of the codec
                wrong = f"cloud of frame {frame} is damaged: {error}"
                raise InputError(wrong, place=folder) from None
            inside = ((points[:, :3] >= low) & (points[:, :3] <= high)).all(axis=1)
            lidar = part.lidar(index)
            numbers = np.arange(part.counts.shape[1]) if lidars is None else np.array(lidars)
            inside &= np.isin(lidar, numbers)
            counts = np.bincount(lidar[inside], minlength=part.counts.shape[1])
            yield points[inside], counts[numbers]

    return PointClouds.from_frames(frames, cut(), crop)


def _no_cloud(folder: Path, missing: Sequence[int]) -> InputError:
    wrong = f"no cloud of frame {missing[0]}, and of {len(missing) - 1} more"
    return InputError(wrong, place=folder)


def clouds_digest(folder: Path) -> str:
    """Hash of all clouds in `folder`; 0.6 s per GB where the processor has SHA instructions.

    Raises OSError for a missing file, ValueError if there is no such folder."""
    digest = hashlib.sha256()
    for path in _parts(folder):
        digest.update(path.name.encode())
        for array in read_clouds(path).arrays().values():
            digest.update(array.reshape(-1).data)
    return digest.hexdigest()


def _parts(folder: Path) -> list[Path]:
    parts = sorted(path.parent for path in folder.glob("*/data.npy"))
    if not parts:
        raise InputError("no recorded clouds", place=folder)
    return parts
