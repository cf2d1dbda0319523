"""Writes a small data set in the layout of the nuScenes v1.0 database, all thirteen tables."""

import itertools
import json
import random
from pathlib import Path
from typing import NamedTuple

LEVEL = (1.0, 0.0, 0.0, 0.0)
TABLES = (
    *("attribute", "calibrated_sensor", "category", "ego_pose", "instance", "log", "map"),
    *("sample", "sample_annotation", "sample_data", "scene", "sensor", "visibility"),
)
CHANNELS = {"CAM_FRONT": "camera", "LIDAR_TOP": "lidar", "RADAR_FRONT": "radar"}


class Box(NamedTuple):
    category: str
    translation: tuple
    size: tuple = (2.0, 4.0, 1.5)  # width, length, height
    rotation: tuple = LEVEL
    instance: str = "a"


class Sample(NamedTuple):
    timestamp: int
    boxes: tuple | list = ()
    translation: tuple = (0.0, 0.0, 0.0)
    rotation: tuple = LEVEL


class Scene(NamedTuple):
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
    at = {"translation": [0.943713, 0.0, 1.84023], "rotation": [0.707, -0.006, 0.01, -0.707]}
    at["camera_intrinsic"] = []
    calibrated = {c: add("calibrated_sensor", sensor_token=sensor[c], **at) for c in CHANNELS}
    day = {"date_captured": "2018-07-24", "location": "boston-seaport"}
    logs = dict.fromkeys(scene.log for scene in scenes)
    log = {name: add("log", logfile=name, vehicle=name, **day) for name in logs}
    add("map", log_tokens=list(log.values()), category="semantic_prior", filename="maps/m.png")

    for scene in scenes:
        instances = {}
        scene_token = token()
        samples = [
            add("sample", timestamp=s.timestamp, prev="", next="", scene_token=scene_token)
            for s in scene.samples
        ]
        row = {"token": scene_token, "log_token": log[scene.log], "nbr_samples": len(samples)}
        row |= {"first_sample_token": samples[0], "last_sample_token": samples[-1]}
        tables["scene"].append(row | {"name": scene.name, "description": "Parked cars, turn left"})
        for sample_token, sample in zip(samples, scene.samples, strict=True):
            # The pose that counts is the LiDAR's at the key frame; the others are elsewhere.
            for channel, is_key in itertools.product(CHANNELS, (True, False)):
                right, photo = channel == "LIDAR_TOP" and is_key, channel == "CAM_FRONT"
                turned = list(sample.rotation) if right else [0.0, 1.0, 0.0, 0.0]
                place = list(sample.translation) if right else [-999.0, 77.0, 5.0]
                pose = {"timestamp": sample.timestamp, "rotation": turned, "translation": place}
                links = {"sample_token": sample_token, "ego_pose_token": add("ego_pose", **pose)}
                links["calibrated_sensor_token"] = calibrated[channel]
                image = {"height": 900 * photo, "width": 1600 * photo}
                image |= {"fileformat": "jpg" if photo else "pcd", "is_key_frame": is_key}
                image |= {"filename": f"samples/{channel}/{sample.timestamp}"}
                time = sample.timestamp + (0 if right else 4321)
                add("sample_data", **links, timestamp=time, **image, prev="", next="")
            for box in sample.boxes:
                if box.instance not in instances:
                    ends = {"first_annotation_token": "", "last_annotation_token": ""}
                    kind = {"category_token": category[box.category], "nbr_annotations": 1}
                    instances[box.instance] = add("instance", **kind, **ends)
                links = {"sample_token": sample_token, "instance_token": instances[box.instance]}
                links |= {"visibility_token": "4", "attribute_tokens": [moving]}
                names = ("translation", "size", "rotation")
                geometry = {name: list(getattr(box, name)) for name in names}
                counts = {"num_lidar_pts": 5, "num_radar_pts": 0}
                add("sample_annotation", **links, **geometry, prev="", next="", **counts)
    folder.mkdir(parents=True)
    shuffle = random.Random(7).shuffle
    for name, rows in tables.items():
        shuffle(rows)
        (folder / f"{name}.json").write_text(json.dumps(rows, indent=0))
    return folder
