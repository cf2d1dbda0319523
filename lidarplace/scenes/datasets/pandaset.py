"""Box logs of PandaSet: a Pandar64 on the roof, and a forward PandarGT.

https://github.com/scaleapi/pandaset-devkit describes the files and has the calibration."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict
from scipy.spatial.transform import Rotation

from lidarplace.base.errors import InputError
from lidarplace.clouds.cloud_files import CloudFile
from lidarplace.configuration.record import Number, read_record
from lidarplace.files.columns import check_columns, numbers, sizes, texts
from lidarplace.files.pickles import read_pickle
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import CLOUD, SOURCE, geometry_of
from lidarplace.logs.convention import Convention
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.recorded import RecordedRig
from lidarplace.rigs.rotations import rotations
from lidarplace.scenes.datasets.class_maps import PANDASET, ClassMap, classify, merged
from lidarplace.scenes.datasets.drives import (
    Drive,
    Models,
    in_frames,
    join_drives,
    models_of,
    recorded_rig,
)
from lidarplace.scenes.datasets.se3 import Poses

CONVENTION = Convention.of(("right", "forward", "up"), "y")
"""Axes of the main LiDAR, and of the world; the front of a box of yaw 0 points along y."""
LIDARS = ("main_pandar64", "front_gt")  # by their number in column d of the points
KNOWN = {"main_pandar64": "pandar64"}  # models in the catalogue
FRONT_GT = Poses(
    np.array([-0.000451117754, -0.605646431446, -0.301525235176]),
    Rotation.from_quat([-0.00206090728, 0.01134678182, 0.99970285343, 0.02147575496]),
)
"""Main LiDAR in the frame of front_gt, of `docs/static_extrinsic_calibration.yaml`. Its cameras
show that the main LiDAR has y to the rear there, and to the front in the poses."""
COLUMNS = ("uuid", "label", "cuboids.sensor_id", "cuboids.sibling_id")
PLACE, SIZE = (tuple(f"{name}.{axis}" for axis in "xyz") for name in ("position", "dimensions"))


class _Vector(BaseModel):
    model_config = ConfigDict(extra="ignore")

    x: Number
    y: Number
    z: Number


class _Quaternion(_Vector):
    w: Number


class _Pose(BaseModel):
    position: _Vector
    heading: _Quaternion


def read_pandaset(
    folder: Path,
    ignored: Counter[str],
    *,
    class_map: ClassMap | None = None,
    keep_ignored: bool = False,
    lidar: Models = None,
    origin: Sequence[float] | None = None,
    test: Sequence[str] = (),
) -> BoxLog:
    """PandaSet: a folder for each sequence, of annotations and LiDAR poses.

    A frame is a file of `annotations/cuboids`, a route a sequence. Moving objects that both LiDARs
    see have a cuboid each; that of front_gt is left out, and counted as its sibling.

    Args:
        folder: holds the sequences, such as 001.
        ignored: gets the number of boxes left out by category.
        class_map: entries that differ from `class_maps.PANDASET`.
        keep_ignored: keep boxes of ignored categories as `class_maps.OTHER`.
        lidar: models; the catalogue has none of front_gt.
        origin: of the main LiDAR in our ego frame, metres; PandaSet does not publish its height.
        test: names of test sequences; all others are for training.

    Raises ValueError if a file is missing or wrong, or a category is unknown."""
    if origin is None:
        fix = "name it: --origin X Y Z, about -0.7 0 2"
        raise InputError("unknown place of the main LiDAR above the ground", place=folder, fix=fix)
    paths = sorted(path.parents[1] for path in folder.glob("*/annotations/cuboids"))
    if not paths:
        raise InputError(place=folder, expected="folders SEQUENCE/annotations/cuboids")
    if unknown := [name for name in test if name not in {path.name for path in paths}]:
        raise InputError("no such sequence", place="--test", found=unknown[0])
    lidars = models_of(LIDARS, lidar, {name: Lidar.named(model) for name, model in KNOWN.items()})
    classes = merged(PANDASET, class_map, keep_ignored)
    drives = [(path, "test" if path.name in test else "train") for path in paths]
    shift = np.asarray(origin, np.float64)
    return join_drives(
        drives, lambda path, start: _sequence(path, start, classes, ignored, lidars, shift)
    )


def _sequence(
    path: Path,
    start: int,
    classes: ClassMap,
    ignored: Counter[str],
    lidars: Sequence[Lidar],
    origin: NDArray[np.float64],
) -> Drive:
    files = sorted((path / "annotations" / "cuboids").glob("[!.]*.pkl.gz"))
    names = [file.name.removesuffix(".pkl.gz") for file in files]
    ego = _vehicle(path / "lidar" / "poses.json", names).moved(-origin)
    times = read_record(path / "lidar" / "timestamps.json", list[Number], "list of times")
    _check_length(path / "lidar" / "timestamps.json", times, names)
    back = Poses(np.zeros((len(names), 3)), Rotation.identity(len(names))).seen_from(ego).matrices()
    to_ego = np.concatenate([back[:, :, :3] @ CONVENTION.matrix, back[:, :, 3:]], axis=2)
    clouds = [f"{path.name}/lidar/{name}.pkl.gz" for name in names]
    frames = pd.DataFrame(
        {
            "scene": path.name,
            "frame": start + np.arange(len(names)),
            "timestamp_s": np.array(times, np.float64) - times[0],
            **ego.ego_columns(),
            CLOUD: [(CloudFile(*each),) for each in zip(clouds, to_ego, strict=True)],
            SOURCE: [f"{path.name}/{name}" for name in names],
        }
    )
    boxes = [
        _boxes(file, frames, n, ego[np.array([n])], classes, ignored)
        for n, file in enumerate(files)
    ]
    return pd.concat(boxes, ignore_index=True), frames, _rig(lidars, origin)


def _vehicle(path: Path, names: Sequence[str]) -> Poses:
    """Return the poses of the main LiDAR in the world, in our axes."""
    poses = read_record(path, list[_Pose], "list of poses")
    _check_length(path, poses, names)
    place = [[pose.position.x, pose.position.y, pose.position.z] for pose in poses]
    turns = [[getattr(pose.heading, axis) for axis in "xyzw"] for pose in poses]
    matrices = rotations(turns, lambda row: f"{path}: pose {row}").as_matrix()
    turned = Rotation.from_matrix(CONVENTION.turns(matrices))
    return Poses(CONVENTION.places(place), turned)


def _check_length(path: Path, values: Sequence[Any], names: Sequence[str]) -> None:
    if not names or len(values) != len(names):
        expected = f"one for each of {len(names)} files in annotations/cuboids"
        raise InputError(place=path, expected=expected, found=len(values))


def _boxes(
    path: Path, frames: pd.DataFrame, row: int, ego: Poses, classes: ClassMap, ignored: Counter[str]
) -> pd.DataFrame:
    """Read the cuboids of a frame, which are in the world."""
    table, source = read_pickle(path), str(path)
    check_columns(list(table.columns), (*COLUMNS, "yaw", *PLACE, *SIZE), source)
    uuid = texts(table, "uuid", source)
    sibling = (table["cuboids.sensor_id"] == 1) & table["cuboids.sibling_id"].isin(uuid)
    rows = np.flatnonzero(~sibling)
    if sibling.any():
        ignored["sibling of front_gt"] += int(sibling.sum())
    place, yaw = numbers(table, PLACE, source)[rows], numbers(table, ["yaw"], source)[rows]
    size = sizes(table, SIZE, source)[rows][:, [1, 0, 2]]
    world = Poses(CONVENTION.places(place), Rotation.from_euler("z", CONVENTION.yaws(yaw)))
    pose = world.seen_from(ego[np.zeros(len(rows), np.int64)])
    category = table["label"].iloc[rows].reset_index(drop=True)
    columns = {
        "object_id": uuid[rows],
        "class": classify(category, classes, lambda n: f"{source}: row {rows[n]}", ignored),
        **geometry_of(pose.position, size, pose.yaw),
    }
    return in_frames(frames, np.full(len(rows), row), columns)


def _rig(lidars: Sequence[Lidar], origin: NDArray[np.float64]) -> RecordedRig:
    """Return the rig, whose main LiDAR is at `origin`."""
    half_turn = Rotation.from_euler("z", np.pi)
    front = half_turn * FRONT_GT.rotation.inv()
    place = -front.apply(FRONT_GT.position)
    places = np.stack([origin, origin + CONVENTION.places(place)])
    turns = CONVENTION.turns(np.stack([np.eye(3), front.as_matrix()]))
    return recorded_rig("pandaset", LIDARS, Poses(places, Rotation.from_matrix(turns)), lidars)
