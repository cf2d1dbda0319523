"""Point clouds of boxes on a plane, without a ray caster: enough for a detector to learn."""

import numpy as np
import pandas as pd
import torch

from lidarplace.clouds.clouds import PointClouds
from lidarplace.logs.boxes import GEOMETRY
from training.dataset import Sample
from training.settings import TrainingSettings

PLAIN = TrainingSettings(flip_y=False, rotation=0.0, scaling=(1.0, 1.0), sample_groups={})
"""No augmentation."""
EMPTY = Sample(np.zeros((0, 4), np.float32), np.zeros((0, 7), np.float32), np.zeros(0, np.int64))
SIZES = {"Car": (4.5, 1.9, 1.6), "Cyclist": (1.8, 0.7, 1.7), "Pedestrian": (0.6, 0.6, 1.75)}
CROP = (0, -20, -1, 40, 20, 5)
BOX_COLUMNS = ["frame", "class", *GEOMETRY]


def scenes(frames, seed, classes=("Car",), objects=5, fewest=1):
    """Clouds and objects of frames in front of the vehicle, with points on their near sides.

    Each frame tries `fewest` to `objects` places; those too near to another object stay empty.
    """
    random = np.random.default_rng(seed)
    clouds, rows = [], []
    for frame in range(frames):
        radius = 1.0 / random.uniform(1 / 45, 1 / 3, 2500)
        azimuth = random.uniform(-np.pi / 2, np.pi / 2, 2500)
        ground = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth)], 1)
        ground = np.column_stack([ground, random.normal(0, 0.02, 2500)])
        parts = [ground]
        centres: list[np.ndarray] = []
        for _ in range(random.integers(fewest, objects + 1)):
            centre = random.uniform((3, -18), (38, 18))
            if any(np.hypot(*(centre - other)) < 6 for other in centres):
                continue
            centres.append(centre)
            name = str(random.choice(classes))
            size = np.array(SIZES[name]) * random.uniform(0.9, 1.1, 3)
            yaw = random.uniform(-np.pi, np.pi)
            rows.append((frame, name, *centre, size[2] / 2, *size, yaw))
            parts.append(_near_sides(random, centre, size, yaw))
        points = np.concatenate(parts)
        points = points[(points[:, 0] > 0) & (points[:, 0] < 40) & (np.abs(points[:, 1]) < 20)]
        clouds.append(np.column_stack([points, np.full(len(points), 0.5)]).astype(np.float32))
    return packed(np.arange(frames), clouds), pd.DataFrame(rows, columns=BOX_COLUMNS)


def packed(numbers, clouds):
    """Point clouds of one LiDAR."""
    frames = ((np.float32(cloud), [len(cloud)]) for cloud in clouds)
    return PointClouds.from_frames(numbers, frames, CROP)


def batch(seed: int = 0, fewest: int = 6):
    """Points, boxes and labels of two frames of cars, as a network takes them."""
    clouds, truth = scenes(2, seed, objects=8, fewest=fewest)
    boxes = [
        torch.tensor(truth.loc[truth.frame == i, list(GEOMETRY)].to_numpy(), dtype=torch.float32)
        for i in range(2)
    ]
    labels = [torch.ones(len(item), dtype=torch.int64) for item in boxes]
    return [torch.from_numpy(clouds[i]) for i in range(2)], boxes, labels


def assert_all_parameters_learn(model, loss):
    """Every gradient of the loss is finite and not 0 everywhere."""
    loss.backward()
    for name, parameter in model.named_parameters():
        assert parameter.grad is not None, name
        assert torch.isfinite(parameter.grad).all(), name
        assert parameter.grad.abs().sum() > 0, name


def _near_sides(random, centre, size, yaw):
    """Points on the vertical sides that face the vehicle, (n, 3): 8000 / r² a square metre."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    turn = np.array([[cos, -sin], [sin, cos]])
    distance = np.hypot(*centre)
    parts = []
    for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1)):
        normal = turn[:, axis] * sign
        face_centre = centre + normal * size[axis] / 2
        facing = -normal @ face_centre / np.hypot(*face_centre)
        if facing <= 0:
            continue
        width = size[1 - axis]
        count = random.poisson(8000.0 * facing * width * size[2] / distance**2)
        along = random.uniform(-width / 2, width / 2, count)
        sides = face_centre + along[:, None] * turn[:, 1 - axis]
        parts.append(np.column_stack([sides, random.uniform(0, size[2], count)]))
    points = np.concatenate(parts) if parts else np.zeros((0, 3))
    return points + random.normal(0, 0.02, points.shape)
