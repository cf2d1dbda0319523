"""KITTI's object layout read once more, from its public description and without lidarplace.

The camera frame has x right, y down, z forward. A label gives height, width, length, the centre of
the bottom, and the angle about y by which the box's length turned from x. A point of the LiDAR is
at P2 · R0_rect · Tr_velo_to_cam · (x, y, z, 1) in the image.
"""

import itertools
from pathlib import Path
from typing import NamedTuple

import numpy as np


class KittiObject(NamedTuple):
    name: str
    truncated: float
    image_box: np.ndarray
    height: float
    width: float
    length: float
    bottom: np.ndarray
    rotation_y: float

    def corners(self) -> np.ndarray:
        """The eight corners, camera frame, shape (8, 3); bits of the index tell the sides."""
        axis_x = np.array([np.cos(self.rotation_y), 0.0, -np.sin(self.rotation_y)])
        axis_z = np.array([np.sin(self.rotation_y), 0.0, np.cos(self.rotation_y)])
        i, j, k = np.array([*itertools.product((0, 1), repeat=3)]).T[:, :, None]
        beside = (i - 0.5) * self.length * axis_x + (j - 0.5) * self.width * axis_z
        return self.bottom + beside - k * self.height * np.array([0.0, 1.0, 0.0])

    def holds(self, points: np.ndarray, margin: float = 0.0) -> np.ndarray:
        """Which points of the camera frame, shape (n, 3), lie in the box."""
        x, y, z = (points - self.bottom).T
        cos, sin = np.cos(self.rotation_y), np.sin(self.rotation_y)
        inside = np.abs(cos * x - sin * z) <= self.length / 2 + margin
        inside &= np.abs(sin * x + cos * z) <= self.width / 2 + margin
        return inside & (y <= margin) & (y >= -self.height - margin)


class KittiFrame(NamedTuple):
    objects: list[KittiObject]
    points: np.ndarray  # camera frame, shape (n, 3)
    intensity: np.ndarray
    projection: np.ndarray  # P2, shape (3, 4)

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """Where points of the camera frame are in the image, shape (n, 2)."""
        homogeneous = np.c_[points, np.ones(len(points))] @ self.projection.T
        return homogeneous[:, :2] / homogeneous[:, 2:]

    def outline(self, item: KittiObject, near: float) -> np.ndarray:
        """Left, top, right, bottom of the part of a box at depths >= near, in no image's bounds."""
        corners = item.corners()
        kept = [corner for corner in corners if corner[2] >= near]
        for a, b in itertools.combinations(range(8), 2):
            low, high = sorted((corners[a], corners[b]), key=lambda corner: corner[2])
            if (a ^ b).bit_count() == 1 and low[2] < near <= high[2]:
                kept.append(low + (near - low[2]) / (high[2] - low[2]) * (high - low))
        if not kept:
            return np.zeros(4)
        pixels = self.pixels(np.array(kept))
        return np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])


def read_frame(root: Path, stem: str) -> KittiFrame:
    """A frame of the folder `training`; matrices by their place in the file, as some tools do."""
    lines = (root / "training" / "calib" / f"{stem}.txt").read_text().split("\n")
    rows = [np.array(line.strip().split(" ")[1:], np.float64) for line in lines[:7]]
    projection, turn, to_camera = rows[2].reshape(3, 4), rows[4].reshape(3, 3), rows[5]
    raw = np.fromfile(root / "training" / "velodyne" / f"{stem}.bin", np.float32).reshape(-1, 4)
    homogeneous = np.c_[raw[:, :3].astype(np.float64), np.ones(len(raw))]
    points = homogeneous @ to_camera.reshape(3, 4).T @ turn.T
    objects = []
    for line in (root / "training" / "label_2" / f"{stem}.txt").read_text().splitlines():
        name, *numbers = line.split(" ")
        truncated, _, _, *value = map(float, numbers)
        image_box, size, bottom = np.array(value[:4]), value[4:7], np.array(value[7:10])
        objects.append(KittiObject(name, truncated, image_box, *size, bottom, value[10]))
    return KittiFrame(objects, points, raw[:, 3], projection)
