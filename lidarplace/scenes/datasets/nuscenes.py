"""Box logs of nuScenes, and of data sets with the tables of its v1.0 database."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.clouds.cloud_files import CloudFile
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import CLOUD, POINTS, SOURCE, first, geometry_of
from lidarplace.rigs.lidar import Lidar
from lidarplace.scenes.datasets.class_maps import NUSCENES, ClassMap, classified, classify, merged
from lidarplace.scenes.datasets.drives import Models, in_frames, models_of, recorded_rig
from lidarplace.scenes.datasets.nuscenes_tables import TokenTable, read_table
from lidarplace.scenes.datasets.se3 import Poses, concatenated, poses

ORIGIN = (2.588 / 2, 0.0, 0.0)
"""Our ego origin in the ego frame of nuScenes, metres. Theirs is the middle of the rear axle,
projected onto the ground (https://github.com/nutonomy/nuscenes-devkit/issues/161); ours lies half a
wheelbase ahead. The vehicles are Renault Zoes, whose wheelbase is 2.588 m."""

LIDAR = "LIDAR_TOP"
"""The annotations of a sample belong to the sweep of this sensor, so its pose is the ego's. In data
sets of the same tables it is the first channel."""
STEPS = 1084  # of its HDL-32E, which turns at 20 Hz; the data sheet's steps are those of 10 Hz
LONGEST_S = 0.5  # from a sample to the nearest pose of the vehicle


@dataclass(frozen=True)
class Vehicle:
    """Vehicle and classes, in which data sets of these tables differ."""

    name: str
    classes: ClassMap
    origin: Sequence[float]  # ours in their ego frame, metres
    poses_by_time: bool = False
    """Whether the ego's pose is the nearest in time, not that of the first channel's sweep."""


ZOE = Vehicle("nuscenes", NUSCENES, ORIGIN)


def read_nuscenes(
    folder: Path,
    *,
    version: str | None = None,
    class_map: ClassMap | None = None,
    test_scenes: Sequence[str] | float = 0.2,
    ignored: Counter[str] | None = None,
    lidar: Models = None,
    keep_ignored: bool = False,
    channels: Sequence[str] = (),
    vehicle: Vehicle = ZOE,
) -> BoxLog:
    """Read the annotated samples (key frames) of nuScenes as a box log.

    Frames count through the log, scene by scene in the order of their names; `route` numbers the
    scenes. Pitch and roll of boxes and of the road are lost. Boxes have `num_lidar_pts` as
    `POINTS`, and a scene has the rig of its first sample, as calibrated.

    Args:
        folder: where the tables are (`v1.0-mini`, …), or the folder above.
        version: which of several versions in `folder`, such as `v1.0-trainval`.
        class_map: entries that differ from those of the vehicle.
        test_scenes: names of the scenes whose frames are test, or the share of recordings that are:
            rows of log.json, or else what names of scenes begin with. A recording is not divided,
            as its scenes lead through one place.
        ignored: gets the number of boxes left out by category.
        lidar: models; None: HDL-32E at 20 Hz for `LIDAR`.
        keep_ignored: keep boxes of ignored categories as `class_maps.OTHER`, which hide.
        channels: the LiDARs of the rig, the one of the ego's poses first; by default all, `LIDAR`
            first.
        vehicle: the data set.

    Raises ValueError if a table is wrong, a token leads nowhere, or a category is unknown."""
    folder = _tables(folder, version)
    class_map = merged(vehicle.classes, class_map, keep_ignored)
    scene = read_table(folder / "scene.json", ("name", "log_token"))
    sample = read_table(folder / "sample.json", ("scene_token", "timestamp"))
    channels = _channels(folder, channels, vehicle)
    defaults = {LIDAR: replace(Lidar.named("hdl32e"), azimuth_steps=STEPS)}
    lidars = models_of(channels, lidar, defaults)
    sweeps = {channel: _sweeps(folder, sample, channel) for channel in channels}
    time = sample.numbers("timestamp")
    ego = _poses(folder, "ego_pose", sweeps[channels[0]])
    if vehicle.poses_by_time:
        ego = _nearest(folder, sample, time)
    ego = ego.moved(vehicle.origin)
    frames, in_order = _frames(scene, sample, time, test_scenes)
    mounts = [_poses(folder, "calibrated_sensor", s, vehicle.origin) for s in sweeps.values()]
    clouds = pd.Series(_clouds(folder, sweeps, ego, in_order), dtype=object)
    frames = frames.assign(**ego[in_order].ego_columns(), **{CLOUD: clouds})

    names = ("sample_token", "instance_token", "translation", "size", "rotation", "num_lidar_pts")
    box = read_table(folder / "sample_annotation.json", names)
    if not len(box):
        raise InputError("no boxes; those of the public test set are secret", place=box.path)
    of_box = box.rows_in(sample, "sample_token")
    columns = {
        "object_id": box.columns["instance_token"],
        "class": classify(_categories(folder, box), class_map, box.row, ignored),
        **in_ego(box, ego[of_box]),
        POINTS: box.numbers("num_lidar_pts"),
    }
    boxes = in_frames(frames, np.argsort(in_order)[of_box], columns)
    if (row := first(boxes[POINTS] < 0)) is not None:
        raise InputError(place=box.row(row), key="num_lidar_pts", expected="at least 0")
    rigs = {}
    for name, rows in frames.groupby("scene").indices.items():
        sensors = concatenated([mount[in_order[rows[:1]]] for mount in mounts])
        rigs[str(name)] = recorded_rig(vehicle.name, channels, sensors, lidars)
    return BoxLog(classified(boxes), frames, rigs=rigs)


def in_ego(box: TokenTable, ego: Poses) -> dict[str, NDArray[np.float64]]:
    """Return columns of `GEOMETRY` from `translation`, `size` and `rotation` of boxes in the world.

    `ego` is our ego frame of every row. Raises ValueError that names file, row and value."""
    size = box.numbers("size", 3)
    if (row := first((size < 0).any(axis=1))) is not None:
        value = size[row].tolist()
        raise InputError(place=box.row(row), key="size", expected="at least 0", found=value)
    pose = poses(box.numbers("translation", 3), box.numbers("rotation", 4), box.row).seen_from(ego)
    return geometry_of(pose.position, size[:, [1, 0, 2]], pose.yaw)


def _tables(folder: Path, version: str | None) -> Path:
    folder = folder / (version or "")
    if (folder / "scene.json").exists():
        return folder
    folders = sorted(path.parent for path in folder.glob("v1.*-*/scene.json"))
    if len(folders) != 1:
        versions, fix = ", ".join(path.name for path in folders), "name a version" * bool(folders)
        expected = "scene.json or one folder v1.0-*"
        raise InputError(place=folder, expected=expected, found=versions or "none", fix=fix)
    return folders[0]


def _frames(
    scene: TokenTable,
    sample: TokenTable,
    time: NDArray[np.float64],
    test_scenes: Sequence[str] | float,
) -> tuple[pd.DataFrame, NDArray[np.int64]]:
    """Return the table of frames, and the row of `sample` of each."""
    names = np.array(scene.columns["name"], dtype=object)
    order = np.argsort(names, kind="stable")
    route_of = np.argsort(order)[sample.rows_in(scene, "scene_token")]
    in_order = np.lexsort((time, route_of))
    route, time_us = route_of[in_order], time[in_order]
    start_us = pd.Series(time_us).groupby(route).transform("first").to_numpy()
    test = _test(scene, order, test_scenes)[order]
    frames = pd.DataFrame(
        {
            "scene": names[order][route],
            "frame": np.arange(len(sample)),
            "timestamp_s": (time_us - start_us) / 1e6,
            "route": route,
            "split": np.where(test, "test", "train")[route],
            SOURCE: np.array(sample.columns["token"], dtype=object)[in_order],
        }
    )
    return frames, in_order


def _clouds(
    folder: Path, sweeps: Mapping[str, TokenTable], ego: Poses, in_order: NDArray[np.int64]
) -> list[tuple[CloudFile, ...]]:
    """Return the files of each frame, by LiDAR: the vehicle drives on from sweep to sweep."""
    files = []
    for channel, sweep in sweeps.items():
        mount, vehicle = (_poses(folder, n, sweep) for n in ("calibrated_sensor", "ego_pose"))
        matrices = mount.posed_by(vehicle).seen_from(ego).matrices()[in_order]
        names = [sweep.columns["filename"][row] for row in in_order]
        pairs = zip(names, matrices, strict=True)
        files.append([CloudFile(name, matrix, channel) for name, matrix in pairs])
    return list(zip(*files, strict=True))


def _nearest(folder: Path, sample: TokenTable, time: NDArray[np.float64]) -> Poses:
    """Return the poses of the vehicle nearest in time to each sample."""
    pose = read_table(folder / "ego_pose.json", ("translation", "rotation", "timestamp"))
    if not len(pose):
        raise InputError("no pose", place=pose.path)
    times = pose.numbers("timestamp")
    order = np.argsort(times, kind="stable")
    after = np.searchsorted(times[order], time).clip(1, max(len(times) - 1, 1))
    pair = order[np.stack([after - 1, after.clip(max=len(times) - 1)])]
    gaps = np.abs(times[pair] - time)
    if (row := first(gaps.min(axis=0) > 1e6 * LONGEST_S)) is not None:
        expected, found = f"one within {LONGEST_S:g} s", f"{gaps.min(axis=0)[row] / 1e6:g} s"
        problem = f"no pose at the time of a sample in {pose.path.name}"
        raise InputError(problem, place=sample.row(row), expected=expected, found=found)
    pose = pose.take(np.take_along_axis(pair, gaps.argmin(axis=0)[None], axis=0)[0])
    return poses(pose.numbers("translation", 3), pose.numbers("rotation", 4), pose.row)


def _test(
    scene: TokenTable, order: NDArray[np.int64], test_scenes: Sequence[str] | float
) -> NDArray[np.bool_]:
    """Return whether each row of `scene` is test; a share takes recordings at even distances."""
    names = scene.columns["name"]
    pairs = zip(scene.columns["log_token"], names, strict=True)
    logs = [log or name.rpartition("-")[0] for log, name in pairs]
    if not isinstance(test_scenes, float | int):
        if unknown := [name for name in test_scenes if name not in names]:
            raise InputError(f"no test scene {unknown[0]!r}", place=scene.path)
        return np.array([name in test_scenes for name in names], bool)
    if not 0 <= test_scenes <= 1:
        raise InputError("share of test recordings", expected="0 to 1", found=test_scenes)
    recordings = list(dict.fromkeys(logs[i] for i in order))
    steps = [math.floor(i * test_scenes + 1e-9) for i in range(len(recordings) + 1)]
    test = {log for i, log in enumerate(recordings) if steps[i + 1] > steps[i]}
    return np.array([log in test for log in logs], bool)


def _channels(folder: Path, channels: Sequence[str], vehicle: Vehicle) -> Sequence[str]:
    """Return the channels of LiDARs, all by default; `LIDAR` is then the first.

    Raises ValueError if one is unknown, or none of them is the first."""
    sensor = read_table(folder / "sensor.json", ("channel", "modality"))
    kinds = zip(sensor.columns["channel"], sensor.columns["modality"], strict=True)
    lidars = sorted({name for name, kind in kinds if kind == "lidar"})
    listed = ", ".join(lidars) or "none"
    if unknown := [name for name in channels if name not in lidars]:
        problem = f"no LiDAR {unknown[0]!r}"
        raise InputError(problem, place="--channel", expected=f"one of {listed}")
    if not lidars:
        raise InputError("no LiDAR", place=sensor.path)
    if vehicle.poses_by_time:
        return channels or lidars
    if not channels and LIDAR not in lidars:
        fix = "name all LiDARs by --channel, the one of the ego's poses first"
        raise InputError(f"no {LIDAR}", place=sensor.path, found=listed, fix=fix)
    return channels or [LIDAR, *(name for name in lidars if name != LIDAR)]


def _sweeps(folder: Path, sample: TokenTable, channel: str) -> TokenTable:
    """Return the rows of `sample_data` that are key frames of a channel, by row of `sample`."""
    sensor = read_table(folder / "sensor.json", ("channel",))
    calibrated = read_table(folder / "calibrated_sensor.json", ("sensor_token",))
    tokens = ("sample_token", "ego_pose_token", "calibrated_sensor_token")
    sweep = read_table(folder / "sample_data.json", (*tokens, "is_key_frame", "filename"))
    lidar = np.array(sensor.columns["channel"], dtype=object) == channel
    by_lidar = lidar[calibrated.rows_in(sensor, "sensor_token")]
    sweep.check("is_key_frame", lambda value: isinstance(value, bool), "true or false")
    by_lidar = by_lidar[sweep.rows_in(calibrated, "calibrated_sensor_token")]
    sweep = sweep.take(np.flatnonzero(by_lidar & np.array(sweep.columns["is_key_frame"], bool)))
    in_sample = sweep.rows_in(sample, "sample_token")
    number = np.bincount(in_sample, minlength=len(sample))
    if (row := first(number != 1)) is not None:
        expected = f"one key frame of {channel} in {sweep.path.name}"
        raise InputError(place=sample.row(row), expected=expected, found=number[row])
    return sweep.take(np.argsort(in_sample))


def _poses(
    folder: Path, name: str, sweep: TokenTable, origin: Sequence[float] = (0.0, 0.0, 0.0)
) -> Poses:
    """Return poses in the table `name`, less `origin`, by row of `sweep`."""
    pose = read_table(folder / f"{name}.json", ("translation", "rotation"))
    pose = pose.take(sweep.rows_in(pose, f"{name}_token"))
    return poses(pose.numbers("translation", 3) - origin, pose.numbers("rotation", 4), pose.row)


def _categories(folder: Path, box: TokenTable) -> pd.Series:
    instance = read_table(folder / "instance.json", ("category_token",))
    category = read_table(folder / "category.json", ("name",))
    of_instance = instance.rows_in(category, "category_token")
    names = np.array(category.columns["name"], dtype=object)
    return pd.Series(names[of_instance[box.rows_in(instance, "instance_token")]])
