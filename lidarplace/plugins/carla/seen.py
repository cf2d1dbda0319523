"""Whether LiDARs hit the road users: some of CARLA's releases and models let rays through."""

from collections import Counter

import numpy as np
import pandas as pd

from lidarplace.clouds.clouds import PointClouds
from lidarplace.logs.boxes import GEOMETRY

NEAR_M = 15.0
"""So near, few things are hidden, and what is seen gets many points."""

ENOUGH = 20
"""So many boxes without a single point are no coincidence."""

MARGIN_M = 0.1
FOOT_M = 0.3
"""Points this low in a box may be of the road."""


def unhit(boxes: pd.DataFrame, models: pd.Series, clouds: PointClouds) -> tuple[list[str], bool]:
    """Models that were near `ENOUGH` times and never hit, sorted; and whether nothing was hit.

    Args:
        boxes: a box log, ego frame.
        models: blueprint of each row of `boxes`.
        clouds: of its frames.
    """
    near, hit = Counter[str](), Counter[str]()
    index_of = {frame: i for i, frame in enumerate(clouds.frames.tolist())}
    close = np.hypot(boxes["x"], boxes["y"]) <= NEAR_M
    for frame, own in boxes[close].assign(model=models).groupby("frame"):
        points = clouds[index_of[frame]][:, :3].astype(np.float64)
        for model, geometry in zip(own["model"], own[list(GEOMETRY)].to_numpy(), strict=True):
            near[model] += 1
            hit[model] += _holds_a_point(geometry, points)
    never = sorted(model for model, count in near.items() if count >= ENOUGH and not hit[model])
    return never, near.total() >= ENOUGH and not hit.total()


def _holds_a_point(box: np.ndarray, points: np.ndarray) -> bool:
    """Whether a point lies in the box, up to a margin, and well above its bottom."""
    x, y, z, length, width, height, yaw = box
    c, s = np.cos(yaw), np.sin(yaw)
    dx, dy, dz = (points - [x, y, z]).T
    along, across = np.abs(c * dx + s * dy), np.abs(c * dy - s * dx)
    inside = (along <= length / 2 + MARGIN_M) & (across <= width / 2 + MARGIN_M)
    return bool((inside & (dz > FOOT_M - height / 2) & (dz <= height / 2 + MARGIN_M)).any())
