"""Small folders of data sets, written from their published descriptions; no data of theirs."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import yaml
from scipy.spatial.transform import Rotation

from tests.lidarplace.test_cloud_files import pcd

# A truck that turns and drives on between the sweeps of its LiDARs.
CHANNELS = ("CAMERA_LEFT_FRONT", "LIDAR_LEFT", "LIDAR_TOP_FRONT")
TRUCK_BOXES = {
    "vehicle.car": ((120.0, 212.0, 0.9), (1.9, 4.6, 1.7), 1.2),
    "vehicle.ego_trailer": ((93.0, 195.0, 2.0), (2.5, 13.6, 4.0), 0.6),
}
MOUNTS = {
    "CAMERA_LEFT_FRONT": ((5.0, 1.0, 2.0), (0.0, 0.0, 0.0)),
    "LIDAR_LEFT": ((4.2, 1.3, 2.1), (1.5, 0.0, 0.0)),
    "LIDAR_TOP_FRONT": ((5.008, -0.014, 3.234), (0.0, 0.98, 0.0)),
}
"""Position, and yaw, pitch and roll."""
START = 1_692_868_171_700_000


def _turn(yaw, pitch=0.0, roll=0.0):
    return Rotation.from_euler("ZYX", [yaw, pitch, roll])


def _wxyz(rotation):
    return rotation.as_quat(scalar_first=True).tolist()


def truck_pose(microseconds):
    """Translation and rotation of the truck, which drives along a circle."""
    angle = 0.5 + 2e-7 * microseconds
    return [100 + 100 * np.sin(angle) - 100 * np.sin(0.5), 200.0 - 5 * angle, 0.0], _turn(angle)


def write_truckscenes(folder: Path, scenes=("scene-ab12-1", "scene-ab12-2", "scene-cd-1")) -> Path:
    """Write the tables of MAN TruckScenes 1.0, and clouds of a point at the car's centre."""
    tables = {
        name: [] for name in ["attribute", "ego_motion_cabin", "ego_motion_chassis", "visibility"]
    }
    tables["weather_annotation"] = []
    tables["sensor"] = [
        {"token": c, "channel": c, "modality": c.partition("_")[0].lower()} for c in CHANNELS
    ]
    tables["calibrated_sensor"] = [
        {"token": f"at-{name}", "sensor_token": name, "translation": list(place)}
        | {"rotation": _wxyz(_turn(*angles)), "camera_intrinsic": []}
        for name, (place, angles) in MOUNTS.items()
    ]
    tables["category"] = [
        {"token": f"c-{c}", "name": c, "description": "", "index": 0} for c in TRUCK_BOXES
    ]
    for name in (*("scene", "sample", "sample_data", "ego_pose", "instance", "sample_annotation"),):
        tables[name] = []
    car, _, _ = TRUCK_BOXES["vehicle.car"]
    for n, scene in enumerate(scenes):
        time, sample = START + 60_000_000 * n, f"sample-{n}"
        tables["scene"].append({"token": scene, "name": scene, "log_token": "", "nbr_samples": 1})
        tables["sample"].append(
            {"token": sample, "timestamp": time, "scene_token": scene, "prev": "", "next": ""}
        )
        for k, channel in enumerate(CHANNELS):
            late = 40_000 * ((k + 1) % 3 - 1) + 1000  # microseconds: the camera is nearest
            place, turn = truck_pose(late)
            pose = {"token": f"pose-{n}-{k}", "timestamp": time + late, "translation": place}
            tables["ego_pose"].append(pose | {"rotation": _wxyz(turn)})
            name = f"samples/{channel}/{time}.pcd"
            tables["sample_data"].append(
                {"token": f"data-{n}-{k}", "sample_token": sample, "ego_pose_token": pose["token"]}
                | {"calibrated_sensor_token": f"at-{channel}", "filename": name, "prev": ""}
                | {"timestamp": time + late, "is_key_frame": True, "fileformat": "pcd", "next": ""}
                | {"width": 0, "height": 0}
            )
            if channel.startswith("LIDAR"):
                mount, angles = MOUNTS[channel]
                in_ego = turn.inv().apply(np.subtract(car, place))
                point = _turn(*angles).inv().apply(in_ego - mount)
                _write_pcd(folder.parent / name, point[None])
        for category, (place, size, yaw) in TRUCK_BOXES.items():
            tables["instance"].append(
                {"token": f"i-{n}-{category}", "category_token": f"c-{category}"}
            )
            tables["sample_annotation"].append(
                {"token": f"a-{n}-{category}", "sample_token": sample, "translation": list(place)}
                | {"instance_token": f"i-{n}-{category}", "attribute_tokens": [], "next": ""}
                | {"size": list(size), "rotation": _wxyz(_turn(yaw)), "num_lidar_pts": 2}
                | {"num_radar_pts": 0, "visibility_token": "", "prev": ""}
            )
    folder.mkdir(parents=True)
    for name, rows in tables.items():
        (folder / f"{name}.json").write_text(json.dumps(rows))
    return folder


def _write_pcd(path, points):
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = np.column_stack([points, np.zeros((len(points), 2))]).astype(np.float32)
    cloud = pd.DataFrame(rows, columns=["x", "y", "z", "intensity", "ring"])
    path.write_bytes(pcd(cloud, "binary"))


# A car and a pair of siblings before a vehicle that heads west by north, in PandaSet.
PANDA_POSE = {
    "position": {"x": 10.0, "y": -4.0, "z": 1.5},
    "heading": dict(zip("wxyz", _wxyz(_turn(0.8, 0.02, -0.01)), strict=True)),
}
CUBOIDS = pd.DataFrame(
    {
        "uuid": ["a", "b", "c", "d"],
        "label": ["Car", "Pedestrian with Object", "Pedestrian with Object", "Bus"],
        "yaw": [0.9, -0.4, -0.3, 0.0],
        "position.x": [-4.0, 2.0, 2.1, 30.0],
        "position.y": [11.0, 9.0, 9.1, 5.0],
        "position.z": [0.6, 0.7, 0.7, 1.5],
        "dimensions.x": [1.9, 0.6, 0.6, 2.5],
        "dimensions.y": [4.4, 0.7, 0.7, 12.0],
        "dimensions.z": [1.6, 1.7, 1.7, 3.2],
        "cuboids.sensor_id": [-1, 0, 1, -1],
        "cuboids.sibling_id": ["", "c", "b", ""],
    }
)


def write_pandaset(folder: Path, sequences=("001", "002"), frames=2) -> Path:
    """Write sequences; each frame has two points of the Pandar64 and one of the PandarGT in a."""
    for sequence in sequences:
        for part in ("annotations/cuboids", "lidar"):
            (folder / sequence / part).mkdir(parents=True)
        points = CUBOIDS.loc[[0, 0, 0], ["position.x", "position.y", "position.z"]].to_numpy()
        cloud = pd.DataFrame(points, columns=list("xyz")).assign(i=7.0, t=1.5e9, d=[0, 0, 1])
        for n in range(frames):
            CUBOIDS.to_pickle(folder / sequence / f"annotations/cuboids/{n:02d}.pkl.gz")
            cloud.to_pickle(folder / sequence / f"lidar/{n:02d}.pkl.gz")
        times = [1.5e9 + 0.1 * n for n in range(frames)]
        (folder / sequence / "lidar/poses.json").write_text(json.dumps([PANDA_POSE] * frames))
        (folder / sequence / "lidar/timestamps.json").write_text(json.dumps(times))
    return folder


# A vehicle that heads to CARLA's -y, an oncoming car to its left and a turned one.
OPV2V_FRAME = {
    "true_ego_pos": [-265.6, 25.6, 0.033, 0.0, -89.0, 0.5],
    "lidar_pose": [-265.6, 26.1, 1.933, 0.0, -89.0, 0.5],
    "predicted_ego_pos": [-265.7, 25.6, 0.04, 0.0, -89.1, 0.5],
    "vehicles": {
        4279: {"angle": [0.0, 89.7, 0.1], "center": [0.004, 0.0, 0.72], "speed": 16.6}
        | {"extent": [2.45, 1.06, 0.75], "location": [-275.6, 5.3, 0.03]},
        4312: {"angle": [-0.1, 129.6, 0.1], "center": [0.02, 0.0, 0.79], "speed": 11.0}
        | {"extent": [2.49, 1.02, 0.78], "location": [-262.0, 2.9, -0.02]},
    },
}
LIDAR = {"channels": 64, "lower_fov": -25, "upper_fov": 2, "range": 120}
LIDAR |= {"points_per_second": 1300000, "rotation_frequency": 20}
PROTOCOL = {
    "vehicle_base": {"sensing": {"perception": {"lidar": LIDAR}}},
    "world": {"fixed_delta_seconds": 0.05},
}


def write_opv2v(folder: Path, splits=("train", "validate")) -> Path:
    """Write a scenario each; a point is where the devkit finds the centre of the first box."""
    for split in splits:
        vehicle = folder / split / f"2021_{split}" / "4288"
        vehicle.mkdir(parents=True)
        (vehicle.parent / "data_protocol.yaml").write_text(yaml.safe_dump(PROTOCOL))
        for tick in (69, 71):
            (vehicle / f"0000{tick}.yaml").write_text(yaml.safe_dump(OPV2V_FRAME))
            _write_pcd(vehicle / f"0000{tick}.pcd", np.array([OPV2V_CENTRE]))
    return folder


OPV2V_CENTRE = (20.61127, -10.35749, -1.36292)
"""Centre of vehicle 4279 in the frame of the LiDAR, of `project_world_objects` of OpenCOOD."""


def write_openpcdet(folder: Path, frames=6) -> Path:
    """Write frames with a car that holds two of three points; the last one is empty."""
    for part in ("points", "labels", "ImageSets"):
        (folder / part).mkdir(parents=True)
    points = np.array([(20, 3, 0.5, 0.1), (21, 3, 1, 0.2), (9, 9, 0, 0)], np.float32)
    names = [f"{n:06d}" for n in range(frames)]
    for name in names:
        np.save(folder / "points" / f"{name}.npy", points)
        line = "20.5 3.0 0.8 4.5 1.9 1.6 0.1 Vehicle\n"
        (folder / "labels" / f"{name}.txt").write_text(line * (name != names[-1]))
    (folder / "ImageSets/train.txt").write_text("\n".join(names[:-2]) + "\n")
    (folder / "ImageSets/val.txt").write_text("\n".join(names[-2:]) + "\n")
    return folder
