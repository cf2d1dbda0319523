"""Detect cars in KITTI's layout: `my_eval.py CLOUDS DETECTIONS`; a place for your own network.

Points above the ground that touch each other from above are an object, and an object is a car of
the mean size of the labels to train with: enough to see how files come and go.
"""

import sys
from pathlib import Path

import numpy as np
from scipy import ndimage

CELL_M, GROUND_M, LIDAR_M = 0.4, 0.3, 1.73


def mean_size(folder: Path) -> np.ndarray:
    """Height, width and length of the cars to train with, metres."""
    lines = [line.split() for path in folder.iterdir() for line in path.read_text().splitlines()]
    return np.mean([[float(x) for x in line[8:11]] for line in lines if line[0] == "Car"], axis=0)


def detect(points: np.ndarray) -> list[tuple[float, float, float]]:
    """x and y of each object in the LiDAR's frame, metres, and the number of its points."""
    points = points[points[:, 2] > GROUND_M - LIDAR_M]
    cells = np.floor(points[:, :2] / CELL_M).astype(int) + 500
    image = np.zeros((1000, 1000), bool)
    image[cells[:, 0], cells[:, 1]] = True
    number, _ = ndimage.label(image, structure=np.ones((3, 3)))
    of_point = number[cells[:, 0], cells[:, 1]]
    objects = [points[of_point == one] for one in np.unique(of_point)]
    return [(*np.ptp(o[:, :2], axis=0) / 2 + o[:, :2].min(axis=0), len(o)) for o in objects]


clouds, detections = Path(sys.argv[1]), Path(sys.argv[2])
height, width, length = mean_size(clouds / "training" / "label_2")
for path in sorted((clouds / "testing" / "velodyne").iterdir()):
    found = detect(np.fromfile(path, np.float32).reshape(-1, 4))
    lines = [
        # Camera frame: x right, y down, z ahead; the bottom of the box is on the ground.
        f"Car 0 0 -10 0 0 0 0 {height:.2f} {width:.2f} {length:.2f} "
        f"{-y:.2f} {LIDAR_M - 0.08:.2f} {x - 0.27:.2f} -1.57 {count / (count + 50):.4f}\n"
        for x, y, count in found
    ]
    (detections / f"{path.stem}.txt").write_text("".join(lines))
print(f"{len(list(detections.iterdir()))} frames, boxes of {length:.1f} m")
