"""Frames as a recording that Foxglove plays: an MCAP file of clouds, boxes and the rig.

https://mcap.dev and https://docs.foxglove.dev/docs/sdk/schemas describe file and messages."""

import json
from collections.abc import Hashable, Iterable, Mapping
from pathlib import Path
from typing import Any

import foxglove
import numpy as np
import pandas as pd
from foxglove import messages
from foxglove.channels import FrameTransformsChannel, PointCloudChannel, SceneUpdateChannel
from foxglove.messages import FrameTransform, PointCloud, SceneEntity
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lidarplace.clouds.clouds import PointClouds
from lidarplace.files.atomic import replacing
from lidarplace.logs.boxes import POSE_COLUMNS, SIZE
from lidarplace.rigs.placement import Placement
from lidarplace.viewing.style import CLASSES

WORLD, EGO = "world", "ego"
"""Frames of coordinates; those of the LiDARs are `lidar_1` and so on."""

STEP_S = 0.1
"""Time between frames whose times are not known."""
PAUSE_S = 1.0
"""Time from the last frame of a drive to the first of the next one: all begin at 0."""


def clock(frames: pd.DataFrame) -> NDArray[np.int64]:
    """Return the time at which each frame is played, (rows,), nanoseconds.

    One drive is played after the other, from 0 on. A drive is a route of a scene. Where a time of
    it is missing, its frames follow by `STEP_S`."""
    seconds = np.zeros(len(frames))
    start = 0.0
    of_drive = frames.reset_index(drop=True).groupby(["scene", "route"], sort=False)
    for _, drive in of_drive:
        time = drive["timestamp_s"].to_numpy(np.float64)
        if np.isnan(time).any():
            time = STEP_S * np.arange(len(drive))
        seconds[drive.index.to_numpy()] = start + time - time.min()
        start += float(np.ptp(time)) + PAUSE_S
    return np.rint(1e9 * seconds).astype(np.int64)


def write_mcap(
    path: Path,
    frames: pd.DataFrame,
    portions: Iterable[tuple[pd.DataFrame, PointClouds]],
    placement: Placement,
) -> None:
    """Write topics `/lidar_1`, … of clouds, `/objects`, `/tf` and `/frame`, in the ego frame.

    `/tf` has the mounts, and the vehicle in the world if the log knows its poses. `frames` are in
    the order of play; `portions` are boxes and clouds of some of them at a time, in that order."""
    times, rows = iter(clock(frames).tolist()), frames.itertuples()
    context = foxglove.Context()  # of its own: nothing else is recorded with it
    lidars = range(len(placement.mounts))
    clouds_of = [PointCloudChannel(f"/lidar_{i + 1}", context=context) for i in lidars]
    objects = SceneUpdateChannel("/objects", context=context)
    transforms = FrameTransformsChannel("/tf", context=context)
    kind: dict[str, Any] = {"schema": {"type": "object"}, "message_encoding": "json"}
    about = foxglove.Channel("/frame", context=context, **kind)
    clear = messages.SceneEntityDeletion(type=messages.SceneEntityDeletionType.All)
    with replacing(path) as partial, foxglove.open_mcap(partial, context=context):
        for boxes, clouds in portions:
            by_frame = dict(list(boxes.groupby("frame")))
            for index, number in enumerate(clouds.frames.tolist()):
                ns, row = next(times), next(rows)
                stamp = messages.Timestamp(ns // 10**9, ns % 10**9)
                held = _transforms(placement, row, stamp)
                transforms.log(messages.FrameTransforms(transforms=held), log_time=ns)
                points, owner = clouds[index], clouds.lidar(index)
                for lidar, channel in enumerate(clouds_of):
                    channel.log(_cloud(points[owner == lidar], stamp), log_time=ns)
                of_frame = by_frame.get(number, boxes.iloc[:0]).to_dict("records")
                entities = [_entity(box, stamp) for box in of_frame]
                update = messages.SceneUpdate(deletions=[clear], entities=entities)
                objects.log(update, log_time=ns)
                facts = {"frame": number, "scene": row.scene, "split": row.split}
                about.log(json.dumps(facts).encode(), log_time=ns)


def _transforms(placement: Placement, row: Any, stamp: Any) -> list[FrameTransform]:
    """Return the mounts of the LiDARs, and the pose of the vehicle in the world where known."""
    poses = [
        (EGO, f"lidar_{number}", mount.position, Rotation.from_matrix(mount.rotation))
        for number, mount in enumerate(placement.mounts, start=1)
    ]
    x, y, yaw = (getattr(row, name, np.nan) for name in POSE_COLUMNS)
    if not np.isnan([x, y, yaw]).any():
        poses.append((WORLD, EGO, np.array([x, y, 0.0]), Rotation.from_euler("z", yaw)))
    return [
        FrameTransform(
            timestamp=stamp,
            parent_frame_id=parent,
            child_frame_id=child,
            translation=_vector(at),
            rotation=_quaternion(turn),
        )
        for parent, child, at, turn in poses
    ]


def _cloud(points: NDArray[np.float32], stamp: Any) -> PointCloud:
    kind = messages.PackedElementFieldNumericType.Float32
    return PointCloud(
        timestamp=stamp,
        frame_id=EGO,
        pose=messages.Pose(position=messages.Vector3(), orientation=_about_z(0.0)),
        point_stride=16,
        fields=[
            messages.PackedElementField(name=name, offset=4 * i, type=kind)
            for i, name in enumerate(("x", "y", "z", "intensity"))
        ],
        data=points.astype("<f4").tobytes(),
    )


def _entity(box: Mapping[Hashable, Any], stamp: Any) -> SceneEntity:
    red, green, blue = (int(CLASSES[box["class"]][i : i + 2], 16) / 255 for i in (1, 3, 5))
    at = [box[name] for name in "xyz"]
    cube = messages.CubePrimitive(
        pose=messages.Pose(position=_vector(at), orientation=_about_z(box["yaw"])),
        size=_vector([box[name] for name in SIZE]),
        color=messages.Color(r=red, g=green, b=blue, a=0.5),
    )
    return SceneEntity(
        timestamp=stamp,
        frame_id=EGO,
        id=str(box["object_id"]),
        metadata=[messages.KeyValuePair(key="class", value=box["class"])],
        cubes=[cube],
    )


def _vector(values: Iterable[float]) -> messages.Vector3:
    return messages.Vector3(**dict(zip("xyz", values, strict=True)))


def _about_z(yaw: float) -> messages.Quaternion:
    return _quaternion(Rotation.from_euler("z", yaw))


def _quaternion(turn: Rotation) -> messages.Quaternion:
    return messages.Quaternion(**dict(zip("xyzw", turn.as_quat().tolist(), strict=True)))
