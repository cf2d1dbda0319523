"""Writes a small data set in the layout of the nuScenes v1.0 database, all thirteen tables."""

import itertools
import json
import random
from dataclasses import dataclass, field
from pathlib import Path

LEVEL = (1.0, 0.0, 0.0, 0.0)
TABLES = (
    *("attribute", "calibrated_sensor", "category", "ego_pose", "instance", "log", "map"),
    *("sample", "sample_annotation", "sample_data", "scene", "sensor", "visibility"),
)
CHANNELS = {"CAM_FRONT": "camera", "LIDAR_TOP": "lidar", "RADAR_FRONT": "radar"}


@dataclass
class Box:
    category: str
    translation: tuple
    size: tuple = (2.0, 4.0, 1.5)  # width, length, height
    rotation: tuple = LEVEL
    instance: str = "a"


@dataclass
class Sample:
    timestamp: int
    boxes: list = field(default_factory=list)
    translation: tuple = (0.0, 0.0, 0.0)
    rotation: tuple = LEVEL


@dataclass
class Scene:
    name: str
    samples: list
    log: str = "n015"


def write_nuscenes(folder: Path, scenes: list, categories: list) -> Path:
    """Write the tables; rows of one table are in no order, as their tokens are what links them."""
    numbers = itertools.count(1)

    def token() -> str:
        return f"{next(numbers):032x}"

    tables = {name: [] for name in TABLES}

    def add(table: str, **row) -> str:
        tables[table].append({"token": token(), **row})
        return tables[table][-1]["token"]

    moving = add("attribute", name="vehicle.moving", description="Vehicle is moving.")
    tables["visibility"].append({"token": "4", "level": "v80-100", "description": "80 to 100%"})
    category = {
        name: add("category", name=name, description=f"What {name} is, in [brackets].")
        for name in categories
    }
    sensor = {name: add("sensor", channel=name, modality=CHANNELS[name]) for name in CHANNELS}
    calibrated = {
        name: add(
            "calibrated_sensor",
            sensor_token=sensor[name],
            translation=[0.943713, 0.0, 1.84023],
            rotation=[0.707, -0.006, 0.01, -0.707],
            camera_intrinsic=[],
        )
        for name in CHANNELS
    }
    log = {
        name: add(
            "log", logfile=name, vehicle=name, date_captured="2018-07-24", location="boston-seaport"
        )
        for name in dict.fromkeys(scene.log for scene in scenes)
    }
    add("map", log_tokens=list(log.values()), category="semantic_prior", filename="maps/m.png")

    for scene in scenes:
        instances = {}
        scene_token = token()
        samples = [
            add("sample", timestamp=s.timestamp, prev="", next="", scene_token=scene_token)
            for s in scene.samples
        ]
        tables["scene"].append(
            {
                "token": scene_token,
                "log_token": log[scene.log],
                "nbr_samples": len(samples),
                "first_sample_token": samples[0],
                "last_sample_token": samples[-1],
                "name": scene.name,
                "description": "Parked cars, turn left",
            }
        )
        for sample_token, sample in zip(samples, scene.samples, strict=True):
            # The pose that counts is the LiDAR's at the key frame; the others are elsewhere.
            for channel, is_key in itertools.product(CHANNELS, (True, False)):
                right = channel == "LIDAR_TOP" and is_key
                pose = add(
                    "ego_pose",
                    timestamp=sample.timestamp,
                    rotation=list(sample.rotation) if right else [0.0, 1.0, 0.0, 0.0],
                    translation=list(sample.translation) if right else [-999.0, 77.0, 5.0],
                )
                add(
                    "sample_data",
                    sample_token=sample_token,
                    ego_pose_token=pose,
                    calibrated_sensor_token=calibrated[channel],
                    timestamp=sample.timestamp + (0 if right else 4321),
                    fileformat="jpg" if channel == "CAM_FRONT" else "pcd",
                    is_key_frame=is_key,
                    height=900 if channel == "CAM_FRONT" else 0,
                    width=1600 if channel == "CAM_FRONT" else 0,
                    filename=f"samples/{channel}/{sample.timestamp}",
                    prev="",
                    next="",
                )
            for box in sample.boxes:
                if box.instance not in instances:
                    instances[box.instance] = add(
                        "instance",
                        category_token=category[box.category],
                        nbr_annotations=1,
                        first_annotation_token="",
                        last_annotation_token="",
                    )
                add(
                    "sample_annotation",
                    sample_token=sample_token,
                    instance_token=instances[box.instance],
                    visibility_token="4",
                    attribute_tokens=[moving],
                    translation=list(box.translation),
                    size=list(box.size),
                    rotation=list(box.rotation),
                    prev="",
                    next="",
                    num_lidar_pts=5,
                    num_radar_pts=0,
                )
    folder.mkdir(parents=True)
    shuffle = random.Random(7).shuffle
    for name, rows in tables.items():
        shuffle(rows)
        (folder / f"{name}.json").write_text(json.dumps(rows, indent=0))
    return folder
