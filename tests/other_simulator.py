"""A log of a two-LiDAR rig whose real clouds come from a simulator that shares nothing with ours.

Cars are ellipsoids, smaller than their labels; the ground rises and falls; beams get lost with
distance and at random; the vehicle hides a sector from the lower LiDAR; a wall has no label.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from lidarplace.logs.box_log import BoxLog, write_box_log
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement
from lidarplace.rigs.recorded import RecordedRig
from lidarplace.scenes.real_clouds import count_real_points

ELEVATIONS = np.radians(np.linspace(-24, 2, 14))
STEPS = 300
MOUNTS = {"top": Mount(z=2.0), "low": Mount(x=2.6, z=0.6)}
LIDAR = Lidar(tuple(ELEVATIONS), azimuth_steps=STEPS, range=80.0)
RIG = RecordedRig(tuple(MOUNTS), Placement("other", list(MOUNTS.values()), LIDAR))
SHADOW = np.radians([150, 210])
"""Azimuths at which the lower LiDAR looks at the vehicle's own body."""
WALL_Y = -12.0


def ground(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Height of the ground, metres."""
    return np.asarray(0.15 * np.sin(x / 9) + 0.01 * y)


def write_log(
    folder: Path, frames: int = 4, seed: int = 0, rig: RecordedRig = RIG, behind: int = 0
) -> BoxLog:
    """A training and a test route of so many frames each, with six cars, and more `behind` the
    wall; the vehicle stands still. Returns the log."""
    random = np.random.default_rng(seed)
    rows = []
    for frame in range(2 * frames):
        for k in range(6 + behind):
            x, y = 8.0 + 4.5 * (k % 6) + 0.3 * frame, random.uniform(-7, 7)
            if k >= 6:
                y += WALL_Y - 9.0
            pose = (x, y, 0.75 + ground(x, y), 4.4, 1.8, 1.5, random.uniform(-0.4, 0.4))
            scene = f"route {frame // frames}"
            rows.append((scene, frame, frame / 10, f"{scene} {k}", "Car", *pose))
    names = ["scene", "frame", "timestamp_s", "object_id", "class", *GEOMETRY]
    number = np.arange(2 * frames)
    table = pd.DataFrame({"frame": number, "timestamp_s": number / 10, "route": number // frames})
    table["scene"] = [f"route {route}" for route in table["route"]]
    table[["ego_x", "ego_y", "ego_yaw"]] = 0.0
    table["split"] = np.where(table["route"] == 0, "train", "test")
    log = BoxLog(
        pd.DataFrame(rows, columns=names), table, rigs=dict.fromkeys(table["scene"].unique(), rig)
    )
    clouds = folder / "sweeps"
    clouds.mkdir(parents=True)
    for frame, boxes in log.boxes.groupby("frame"):
        parts = [
            cast(boxes[list(GEOMETRY)].to_numpy(), name, random).assign(lidar=name)
            for name in rig.names
        ]
        pd.concat(parts, ignore_index=True).to_parquet(clouds / f"{frame}.parquet")
    recorded = folder / "clouds" / "recorded"
    counted, _ = count_real_points(log, clouds, (0.0, 0.0, 0.0), recorded)
    write_box_log(folder, counted)
    return counted


def cast(boxes: np.ndarray, name: str, random: np.random.Generator) -> pd.DataFrame:
    """The points of one LiDAR in a frame: x, y, z in the ego frame, intensity, ring."""
    mount = MOUNTS[name]
    origin = np.array([mount.x, mount.y, mount.z])
    azimuth, ring = np.meshgrid(np.arange(STEPS) * 2 * np.pi / STEPS, np.arange(len(ELEVATIONS)))
    azimuth, ring = azimuth.ravel(), ring.ravel()
    up = ELEVATIONS[ring]
    ray = np.stack([np.cos(up) * np.cos(azimuth), np.cos(up) * np.sin(azimuth), np.sin(up)], 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        to_wall = np.where(ray[:, 1] < 0, (WALL_Y - origin[1]) / ray[:, 1], np.inf)
        to_wall[origin[2] + to_wall * ray[:, 2] > 2.5] = np.inf
        down = np.where(ray[:, 2] < 0, -origin[2] / ray[:, 2], np.inf)
        for _ in range(8):  # towards the height where the ray is
            at = origin[:2] + np.minimum(down, 200.0)[:, None] * ray[:, :2]
            down = np.where(ray[:, 2] < 0, (ground(*at.T) - origin[2]) / ray[:, 2], np.inf)
    distance, of_car = np.minimum(to_wall, down), np.zeros(len(ray), bool)
    for x, y, z, *size, yaw in boxes:
        turn = np.array([[np.cos(yaw), np.sin(yaw), 0], [-np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
        half = np.array(size) / 2 - 0.1
        a, b = turn @ ray.T, turn @ (origin - [x, y, z])
        a, b = a / half[:, None], b / half
        square, projection = (a**2).sum(0), b @ a
        root = projection**2 - square * (b @ b - 1)
        hit = np.where(root > 0, (-projection - np.sqrt(np.maximum(root, 0))) / square, np.inf)
        nearer = (hit > 0) & (hit < distance)
        distance[nearer], of_car[nearer] = hit[nearer], True
    returns = distance < 80
    share = np.where(of_car, 0.7, 1.0) * np.exp(-np.minimum(distance, 80) / 70)
    returns &= random.uniform(size=len(ray)) < share
    if name == "low":
        returns &= (azimuth < SHADOW[0]) | (azimuth > SHADOW[1])
    noisy = distance + random.normal(0, 0.02, len(ray))
    points = origin + noisy[returns, None] * ray[returns]
    cloud = pd.DataFrame(points, columns=list("xyz"))
    return cloud.assign(intensity=np.where(of_car[returns], 0.6, 0.2), ring=ring[returns])
