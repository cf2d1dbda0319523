"""Whether LiDARs hit the road users: some of CARLA's releases and models let rays through."""

from collections import Counter

import numpy as np
import pandas as pd

from lidarplace.clouds.clouds import PointClouds
from lidarplace.clouds.points_in_boxes import count_points
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
        near.update(own["model"])
        solid = own[list(GEOMETRY)].to_numpy(np.float64, copy=True)
        solid[:, 2] += (FOOT_M + MARGIN_M) / 2
        solid[:, 3:6] += [2 * MARGIN_M, 2 * MARGIN_M, MARGIN_M - FOOT_M]
        hit.update(own["model"][count_points(clouds[index_of[frame]], solid) > 0])
    never = sorted(model for model, count in near.items() if count >= ENOUGH and not hit[model])
    return never, near.total() >= ENOUGH and not hit.total()
