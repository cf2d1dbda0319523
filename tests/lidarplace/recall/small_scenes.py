"""Scenes of a few bricks, and what rays hit of them by plain Python."""

import math

import numpy as np
import pandas as pd
from hypothesis import strategies as st

from lidarplace import ExpectedRecall, Lidar, Mount, Roi
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.recall.detection_curve import DetectionCurves
from lidarplace.recall.surface_cells import SurfaceCells
from tests.lidarplace.requirements.brute_force import cells_of, entered, in_frame_of

ROI = Roi((0, 40), (-20, 20), (0, 4), resolution=0.5)
LIDAR = Lidar(tuple(np.radians([-11.0, -7.0, -4.0, -1.5, 0.5])), azimuth_steps=720)
"""Its rays pass above the vehicle's own body, seen from 2 m above the ground or higher."""
MOUNTS = (
    Mount(0.3, 0.5, 2.2, roll=0.02, pitch=-0.01, yaw=0.7),
    Mount(-0.2, -0.6, 2.6, yaw=-2.0),
    Mount(0.0, 0.0, 3.0, pitch=0.03),
)
ROWS = (
    (0, "Tram", 12.0, 1.0, 4.5, 1.8, 1.6, 0.4),
    (0, "Bus", 20.0, 2.0, 8.0, 2.5, 3.0, -0.3),  # partly hidden by the first
    (0, "Tram", 15.0, -8.0, 3.0, 1.0, 2.0, 1.9),
    (0, "Bus", 39.0, 14.0, 6.0, 2.5, 3.5, 0.1),  # a part of it is outside of the ROI
    (3, "Tram", 9.0, -3.0, 2.0, 2.0, 2.2, 0.0),
)
_CURVES = (("Tram", 0.5, 0.9, 0.05), ("Bus", 0.5, 0.7, 0.2), ("Tram", 0.7, 0.6, 0.01))
_KEYS = ("class", "iou", "most", "rate")
CURVES = DetectionCurves(
    command="by hand", cell=0.3, curves=[dict(zip(_KEYS, own, strict=True)) for own in _CURVES]
)


def log_of(*rows, buildings=None):
    """Rows of frame, class, x, y, length, width, height, yaw; boxes stand on the ground.

    What is of no known class fills its box. Every row is an individual of its own.
    """
    frame, name, x, y, length, width, height, yaw = (
        np.array(column) for column in zip(*rows, strict=True)
    )
    data = [x, y, height / 2, length, width, height, yaw]
    boxes = pd.DataFrame(dict(zip(GEOMETRY, data, strict=True)))
    boxes = boxes.assign(scene="a", frame=frame, object_id=[f"o{n}" for n in range(len(rows))])
    boxes["class"] = name
    numbers = np.unique(frame)
    frames = pd.DataFrame(
        {"scene": "a", "frame": numbers, "ego_x": 0.0, "ego_y": 0.0, "ego_yaw": 0.0}
    )
    return BoxLog(boxes, frames) if buildings is None else BoxLog(boxes, frames, buildings)


def model_of(*rows, classes=("Tram", "Bus"), **options):
    """The surrogate of `log_of` these rows, or of ROWS."""
    return ExpectedRecall.from_log(log_of(*(rows or ROWS)), ROI, classes, CURVES, **options)


def cells_hit(boxes, mounts, lidar, cell, roi):
    """Of every box the set of cells (i, j, k) and the number of points, in one frame."""
    cells, points = [set() for _ in boxes], [0] * len(boxes)
    for mount in mounts:
        rays = lidar.directions() @ mount.rotation.T
        own = [in_frame_of(box, mount.position, rays) for box in boxes]
        for number, ray in enumerate(rays):
            reach, b = min(
                (entered(eye.tolist(), ways[number].tolist(), [0.0] * 3, box[3:6]), b)
                for b, (box, (eye, ways)) in enumerate(zip(boxes, own, strict=True))
            )
            if math.isinf(reach) or reach > lidar.range:
                continue
            hit = mount.position + reach * ray
            spans = zip(hit, (roi.x, roi.y, roi.z), strict=True)
            if all(low <= value <= high for value, (low, high) in spans):
                eye, ways = own[b]
                cells[b] |= cells_of([eye + reach * ways[number]], boxes[b][3:6], cell)
                points[b] += 1
    return cells, points


def decoded(seen, slices):
    """Sets of (i, j, k) of every object."""
    rows = [seen.cells[a:b] for a, b in zip(seen.offsets[:-1], seen.offsets[1:], strict=True)]
    return [
        {tuple(int(i) for i in np.unravel_index(int(cell), tuple(own))) for cell in row}
        for row, own in zip(rows, slices, strict=True)
    ]


rows_of_cells = st.lists(st.sets(st.integers(0, 30), max_size=12), min_size=5, max_size=5)


def table_of(rows):
    counts = [len(row) for row in rows]
    return SurfaceCells(
        np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        np.array([cell for row in rows for cell in sorted(row)], np.uint32),
        np.array(counts, np.int64),
    )
