"""A data set in the layout of nuScenes v1.0, as its devkit reads it; see `scenes.layouts`."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lidarplace.files.png import black_png
from lidarplace.scenes.datasets.nuscenes import LIDAR, ORIGIN
from lidarplace.scenes.datasets.se3 import Poses

VERSIONS = {"train": "v1.0-trainval", "test": "v1.0-test"}
"""Folder of the tables of a split; as in nuScenes, test has no annotations."""

CATEGORIES = {
    "Car": "vehicle.car",
    "Cyclist": "vehicle.bicycle",
    "Pedestrian": "human.pedestrian.adult",
}
"""Categories of our classes; others keep their names."""

SENSOR = Poses(np.array([[0.943713, 0.0, 1.84023]]), Rotation.from_euler("z", [[-np.pi / 2]]))
"""The frame of the points in nuScenes' ego frame: that of its LiDAR, x to the right."""

_START_US, _APART_US = 1_500_000_000_000_000, 10_000_000_000


def names_of(frames: pd.DataFrame) -> pd.Series:
    """Tokens of samples."""
    return _tokens(frames["frame"])


def path_of(frame: Any) -> str:
    """The file of a frame's cloud."""
    return f"samples/{LIDAR}/{frame.frame}.pcd.bin"


def write_sweep(path: Path, points: NDArray[np.float32]) -> None:
    """Write points, ego frame, shape (n, 4); all are of ring 0."""
    own = np.zeros((len(points), 5), "<f4")
    place = SENSOR.position[0] - ORIGIN
    own[:, :3] = (points[:, :3] - place) @ SENSOR.rotation[0].as_matrix()
    own[:, 3] = np.round(255 * points[:, 3])
    own.tofile(path)


def write_tables(folder: Path, frames: pd.DataFrame, boxes: pd.DataFrame) -> None:
    """Write the thirteen tables of each of `VERSIONS`.

    Args:
        frames: with poses, `sequence` and `time_us`.
        boxes: of frames to train, with the poses of these, and `points` in each.
    """
    (folder / "maps").mkdir()
    (folder / "maps" / "none.png").write_bytes(black_png(1, 1))  # the devkit wants one
    for split, version in VERSIONS.items():
        (folder / version).mkdir()
        tables = _fixed() | _samples(frames[frames["split"] == split])
        tables |= _annotations(boxes if split == "train" else boxes[:0])
        for name, table in tables.items():
            path = folder / version / f"{name}.json"
            table.to_json(path, orient="records", double_precision=15, indent=0)


def _fixed() -> dict[str, pd.DataFrame]:
    """Tables of one row, whatever the frames."""
    place = {name: own[0] for name, own in _posed(SENSOR, [0]).items()}
    rows = {
        "calibrated_sensor": {"sensor_token": "0", "camera_intrinsic": [], **place},
        "log": {"logfile": "lidarplace", "vehicle": "", "date_captured": "", "location": ""},
        "map": {"log_tokens": ["0"], "category": "semantic_prior", "filename": "maps/none.png"},
        "sensor": {"channel": LIDAR, "modality": "lidar"},
        "visibility": {"level": "v80-100", "description": ""},
    }
    return {"attribute": pd.DataFrame()} | {
        name: pd.Series({"token": "0", **row}).to_frame().T for name, row in rows.items()
    }


def _samples(frames: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Scenes, their samples, and clouds and poses of these."""
    token, scene = _tokens(frames["frame"]), frames["sequence"]
    linked = _linked(token, scene)
    time = _START_US + _APART_US * scene.str.partition("-")[0].astype(int) + frames["time_us"]
    own = pd.DataFrame({"token": token, "timestamp": time})
    files = [path_of(frame) for frame in frames.itertuples()]
    sweeps = own.assign(sample_token=token, ego_pose_token=token, filename=files, **linked)
    sweeps = sweeps.assign(calibrated_sensor_token="0", fileformat="pcd", is_key_frame=True)
    ego = Poses.of_ego(frames).moved([-own for own in ORIGIN])
    of_scene = token.groupby(scene.to_numpy()).agg(["size", "first", "last"]).reset_index()
    of_scene.columns = pd.Index(["name", "nbr_samples", "first_sample_token", "last_sample_token"])
    return {
        "sample": own.assign(scene_token=scene, **linked),
        "sample_data": sweeps.assign(height=0, width=0),
        "ego_pose": own.assign(**_posed(ego, frames.index)),
        "scene": of_scene.assign(token=of_scene["name"], log_token="0", description=""),
    }


def _annotations(boxes: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Boxes in the world, the objects that they are of, and their categories."""
    world = Poses.of_boxes(boxes).posed_by(Poses.of_ego(boxes))
    objects = boxes.groupby(["scene", "object_id", "class"])
    instance = _tokens(objects.ngroup())
    token = _tokens(pd.Series(range(len(boxes)), boxes.index))
    annotations = pd.DataFrame(
        {
            "token": token,
            "sample_token": _tokens(boxes["frame"]),
            "instance_token": instance,
            "size": boxes[["width", "length", "height"]].to_numpy(np.float64).tolist(),
            **_posed(world, boxes.index),
            **_linked(token, instance),
            "num_lidar_pts": boxes["points"],
            "num_radar_pts": 0,
            "visibility_token": "0",
            "attribute_tokens": [[] for _ in token],
        }
    )
    instances = token.groupby(instance.to_numpy()).agg(["size", "first", "last"])
    names = ["nbr_annotations", "first_annotation_token", "last_annotation_token"]
    instances.columns = pd.Index(names)
    category = boxes["class"].map(lambda name: CATEGORIES.get(name, name))
    of_instance = category.groupby(instance.to_numpy()).first()
    every = pd.Series(category.unique(), dtype=object)
    return {
        "sample_annotation": annotations,
        "instance": instances.assign(category_token=of_instance).reset_index(names="token"),
        "category": pd.DataFrame({"token": every, "name": every, "description": ""}),
    }


def _tokens(numbers: pd.Series) -> pd.Series:
    """Tokens of rows, each unique in its table."""
    return numbers.map("{:032x}".format)


def _posed(poses: Poses, index: pd.Index | list[int]) -> dict[str, pd.Series]:
    """`translation` and `rotation` of each."""
    places = {"translation": poses.position, "rotation": poses.quaternions}
    return {name: pd.Series(own.tolist(), index) for name, own in places.items()}


def _linked(token: pd.Series, of: pd.Series) -> dict[str, pd.Series]:
    """Tokens of the rows before and after each, of the same scene or object."""
    groups = token.groupby(of.to_numpy())
    return {name: groups.shift(step).fillna("") for name, step in (("prev", 1), ("next", -1))}
