"""Real clouds of a log: points counted in its boxes, and kept in the ego frame."""

import shutil
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.base.number_text import percent
from lidarplace.clouds.cloud_files import CLOUD_SUFFIXES, CloudFile, read_cloud
from lidarplace.clouds.clouds import Crop, PointClouds, write_clouds
from lidarplace.clouds.points_in_boxes import count_points
from lidarplace.files.atomic import temporary
from lidarplace.files.regular import is_there
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import CLOUD, GEOMETRY, POINTS, first
from lidarplace.rigs.recorded import RecordedRig

KEPT: Crop = (-150.0, -150.0, -20.0, 150.0, 150.0, 40.0)
"""Real points are kept within these bounds, on a grid of 4.6 mm; all of them are counted."""
PART = 500
"""Frames that are packed in memory before they are written: of 100,000 points about 260 MB."""
NEAR_M = 40.0  # boxes so near show whether clouds are in their frame
AROUND_M = 0.5
FLOOR_M = 0.3
"""Points so far around and above a box, and so high above its underside: in the right frame most
are inside."""
LOOKED_AT = 100  # at most about so many frames are looked at for it
LEAST_POINTS = 10
LEAST_BOXES = 5
MOST_OUTSIDE = 0.35
Files = tuple[tuple[Path, CloudFile | None], ...]
"""Files of a frame's points; None: in the frame of the rig's only LiDAR, or from an origin on."""
Sweep = tuple[NDArray[np.float32], NDArray[np.int64]]
"""Points of a frame: x, y, z in the ego frame, metres, and intensity in [0, 1], shape (n, 4), by
LiDAR, in the order of the file; and how many each LiDAR of the rig has, or all where none is known.
"""


def count_real_points(
    log: BoxLog, folder: Path, origin: Sequence[float] | None = None, keep: Path | None = None
) -> tuple[BoxLog, int]:
    """Count the points of clouds in the boxes of a log; return it, and the number of clouds.

    `points/NAME` is counted for each LiDAR of a rig, and `POINTS` where the log has no counts.
    Boxes of frames without a cloud have NaN. Raises ValueError if no frame has a cloud, a file is
    wrong, or clouds do not fit rig or boxes.

    Args:
        log: the log; its rigs split the counts.
        folder: holds the file of each frame by the path in column `CLOUD` of the frames, or by the
            last part of it; without that column `SCENE/FRAME.*` or `FRAME.*` by the frame's number.
            The column may hold a tuple of `CloudFile` instead.
        origin: where the frame of the points starts in our ego frame, metres, its axes being ours;
            None: it is the frame of the rig's only LiDAR. `CloudFile` has a frame of its own.
        keep: gets the clouds, cut to `KEPT`, a folder for `PART` frames of a scene."""
    paths = _paths(log.frames, folder)
    if not paths:
        named = f"files named by frame numbers, such as SCENE/{log.frames['frame'].iloc[0]}.pcd"
        first_cloud = log.frames[CLOUD].iloc[0] if CLOUD in log.frames else named
        expected = first_cloud if isinstance(first_cloud, str) else first_cloud[0].path
        raise InputError("no cloud of any frame", place=folder, expected=expected)
    boxes = log.boxes.reset_index(drop=True)
    counter = _PointCounter(boxes, paths, origin)
    scenes = log.frames[log.frames["frame"].isin(paths)].groupby("scene", sort=False)["frame"]
    parts = [
        (str(scene), frames.tolist()[start : start + PART])
        for scene, frames in scenes
        for start in range(0, len(frames), PART)
    ]
    with nullcontext() if keep is None else _new_folder(keep) as partial:
        for number, (scene, numbers) in enumerate(parts):
            sweeps = counter.sweeps(numbers, log.rigs.get(scene))
            if partial is None:
                deque(sweeps, maxlen=0)  # only counted
            else:
                packed = PointClouds.from_frames(numbers, map(_kept, sweeps), KEPT)
                write_clouds(partial / f"{number:04d}", packed)
        _check_frame(counter.geometry, counter.inside, counter.around, folder)
    if POINTS in boxes:
        counter.counts.pop(POINTS, None)
    return replace(log, boxes=boxes.assign(**counter.counts)), len(paths)


class _PointCounter:
    """Counts of points in the boxes of a log, sweep by sweep."""

    def __init__(
        self, boxes: pd.DataFrame, paths: Mapping[int, Files], origin: Sequence[float] | None
    ) -> None:
        self._paths, self._origin = paths, origin
        self._rows_of = boxes.groupby("frame").indices
        self._looked_at = set(list(paths)[:: 1 + len(paths) // LOOKED_AT])
        self.geometry = boxes[list(GEOMETRY)].to_numpy(np.float64)
        self.counts: dict[str, NDArray[np.float64]] = {}
        self.inside, self.around = (np.full(len(boxes), np.nan) for _ in range(2))

    def sweeps(self, frames: Sequence[int], rig: RecordedRig | None) -> Iterator[Sweep]:
        """Yield the sweeps of frames of a scene, and count their points."""
        lidars = 0
        for frame in frames:
            sweep, split = read_sweep(self._paths[frame], rig, self._origin)
            lidars = lidars or len(split)
            if lidars != len(split):
                problem = "column lidar is in some clouds of the scene and not in others"
                raise InputError(problem, place=self._paths[frame][0][0])
            rows = self._rows_of.get(frame, np.empty(0, np.int64))
            boxes = self.geometry[rows]
            points = np.split(sweep, np.cumsum(split)[:-1])
            by_lidar = np.array([count_points(each, boxes) for each in points])
            columns = {POINTS: by_lidar.sum(axis=0)}
            if rig is not None and len(rig.names) == len(by_lidar):
                columns |= {f"{POINTS}/{n}": c for n, c in zip(rig.names, by_lidar, strict=True)}
            for name, counts in columns.items():
                unknown = np.full(len(self.geometry), np.nan)
                self.counts.setdefault(name, unknown)[rows] = counts
            if frame in self._looked_at:
                self.inside[rows], self.around[rows] = _near_points(sweep, boxes)
            yield sweep, split


@contextmanager
def _new_folder(folder: Path) -> Iterator[Path]:
    """Make a folder that takes the place of `folder` at the end; without it, parents go, too."""
    partial = temporary(folder)
    try:
        yield partial
        shutil.rmtree(folder, ignore_errors=True)
        partial.rename(folder)
    finally:
        shutil.rmtree(partial, ignore_errors=True)
        for parent in folder.parents[:2]:  # a log's that was not written
            with suppress(OSError):
                parent.rmdir()


def _paths(frames: pd.DataFrame, folder: Path) -> dict[int, Files]:
    """Return the files of each frame that has some."""
    numbers, clouds = frames["frame"].tolist(), []
    if CLOUD in frames:
        clouds = [_files(cloud, folder) for cloud in frames[CLOUD]]
    else:
        files: dict[tuple[str, int], Path] = {}  # "" is the scene of those in the folder itself
        for path in sorted([*folder.glob("[!.]*"), *folder.glob("[!.]*/[!.]*")]):
            stem = path.name.partition(".")[0]
            if path.name.lower().endswith(CLOUD_SUFFIXES) and stem.isdecimal():
                files["" if path.parent == folder else path.parent.name, int(stem)] = path
        keys = zip(frames["scene"].map(str), numbers, strict=True)
        paths = [files.get(key) or files.get(("", key[1])) for key in keys]
        clouds = [((path, None),) if path else () for path in paths]
    return {n: cloud for n, cloud in zip(numbers, clouds, strict=True) if cloud}


def _files(cloud: str | Sequence[CloudFile], folder: Path) -> Files:
    """Return the files of a frame, empty if none is there; raise InputError if only some are."""
    files = [cloud] if isinstance(cloud, str) else [file.path for file in cloud]
    paths = []
    for name in files:
        names = (name, Path("training") / name, Path(name).name)
        paths.append(next((folder / n for n in names if is_there(folder / n)), None))
    if None in paths:
        if any(paths):
            problem = "missing, but other files of the frame are there"
            raise InputError(problem, place=folder / files[paths.index(None)])
        return ()
    frames = [None] if isinstance(cloud, str) else cloud
    return tuple(zip(map(Path, filter(None, paths)), frames, strict=True))


def read_sweep(files: Files, rig: RecordedRig | None, origin: Sequence[float] | None) -> Sweep:
    """Read the points of a frame's files, in the ego frame and by LiDAR.

    `origin` is that of `count_real_points`. Points without a place are left out. Raises ValueError
    as `read_cloud`, and if LiDARs or rings are none of the rig's, or nothing places the sensor."""
    sweeps = [_read_file(*file, rig, origin) for file in files]
    number = max(split for _, _, split in sweeps)
    points, lidar = (np.concatenate(parts) for parts in list(zip(*sweeps, strict=True))[:2])
    order = np.argsort(lidar, kind="stable")
    return points[order], np.bincount(lidar, minlength=number)


def _read_file(
    path: Path, file: CloudFile | None, rig: RecordedRig | None, origin: Sequence[float] | None
) -> tuple[NDArray[np.float32], NDArray[np.int64], int]:
    """Return points, (n, 4), the LiDAR of each, (n,), and the number of distinct LiDARs."""
    cloud = read_cloud(path)
    cloud = cloud[np.isfinite(cloud[list("xyz")].to_numpy()).all(axis=1)]
    if file is not None and file.lidar:
        cloud = cloud.assign(lidar=file.lidar)
    lidar, number = np.zeros(len(cloud), np.int64), 1
    if rig is not None and (len(rig.names) == 1 or "lidar" in cloud):
        lidar, number = _lidars(cloud, rig, path), len(rig.names)
        _check_rings(cloud, lidar, rig, path)
    points = np.zeros((len(cloud), 4), np.float32)
    place = cloud[list("xyz")].to_numpy(np.float64)
    if file is not None:
        place = place @ file.to_ego[:, :3].T + file.to_ego[:, 3]
    elif origin is not None:
        place += np.asarray(origin)
    elif rig is not None and len(rig.names) == 1:
        (mount,) = rig.placement.mounts
        place = place @ mount.rotation.T + mount.position
    else:
        raise InputError("clouds in the frame of a LiDAR need a rig of one LiDAR", place=path)
    points[:, :3] = place
    if "intensity" in cloud:
        points[:, 3] = np.nan_to_num(cloud["intensity"].to_numpy(np.float32))
    return points, lidar, number


def _lidars(cloud: pd.DataFrame, rig: RecordedRig, path: Path) -> NDArray[np.int64]:
    if len(rig.names) == 1:
        return np.zeros(len(cloud), np.int64)
    values = cloud["lidar"]
    if values.dtype.kind in "iuf":
        numbers = values.fillna(-1).to_numpy(np.int64)
    else:
        numbers = pd.Index(rig.names).get_indexer(pd.Index(values.astype(str)))
    if (row := first((numbers < 0) | (numbers >= len(rig.names)))) is not None:
        problem = "point of a LiDAR that is not in the rig"
        expected = f"{', '.join(rig.names)}, or their numbers from 0"
        raise InputError(
            problem, place=path, key="lidar", expected=expected, found=values.iloc[row]
        )
    return np.asarray(numbers, np.int64)


def _check_rings(
    cloud: pd.DataFrame, lidar: NDArray[np.int64], rig: RecordedRig, path: Path
) -> None:
    """Raise InputError if a LiDAR has rings beyond the beams of its model."""
    if "ring" not in cloud:
        return
    ring = cloud["ring"].to_numpy(np.float64)
    for number, (name, model) in enumerate(zip(rig.names, rig.placement.lidars, strict=True)):
        most = np.nanmax(ring[lidar == number], initial=-1)
        if most >= model.beams:
            problem = f"rings of {name} beyond the beams of its model"
            expected, fix = f"0 to {model.beams - 1}", "--lidar names another model"
            raise InputError(problem, place=path, expected=expected, found=f"{most:g}", fix=fix)


def _near_points(
    points: NDArray[np.float32], boxes: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Count points in each box above its floor, and in the box grown to its sides; (m,) each."""
    raised = boxes.copy()
    raised[:, 5] = np.maximum(raised[:, 5] - FLOOR_M, 0)
    raised[:, 2] += FLOOR_M / 2
    grown = raised.copy()
    grown[:, 3:5] += 2 * AROUND_M
    grown[:, 5] += AROUND_M
    grown[:, 2] += AROUND_M / 2
    return count_points(points, raised), count_points(points, grown)


def _check_frame(
    boxes: NDArray[np.float64],
    inside: NDArray[np.float64],
    around: NDArray[np.float64],
    folder: Path,
) -> None:
    """Raise InputError if most points around near boxes are outside of them, or none is in any."""
    near = (np.hypot(boxes[:, 0], boxes[:, 1]) < NEAR_M) & ~np.isnan(around)
    compared = near & (around >= LEAST_POINTS)
    few = compared.sum() < LEAST_BOXES
    if near.sum() < LEAST_BOXES or (few and inside[near].any()):
        return
    compared = near if few else compared
    outside = float(np.median(1 - inside[compared] / np.maximum(around[compared], 1)))
    if outside > MOST_OUTSIDE:
        problem = f"points around boxes are outside of them (median of {compared.sum():,} boxes)"
        parts = {"expected": f"at most {percent(MOST_OUTSIDE)}", "found": f"{percent(outside)}"}
        fix = "are the clouds in another frame, or of other frames?"
        raise InputError(problem, place=folder, fix=fix, **parts)


def _kept(sweep: Sweep) -> Sweep:
    points, counts = sweep
    inside = ((points[:, :3] >= KEPT[:3]) & (points[:, :3] <= KEPT[3:])).all(axis=1)
    lidar = np.repeat(np.arange(len(counts)), counts)
    return points[inside], np.bincount(lidar[inside], minlength=len(counts))
