"""The tables of the paper, to draw a sweep's own results beside them.

"Investigating the Impact of Multi-LiDAR Placement on Object Detection for Autonomous Driving",
CVPR 2022. Placements, classes, detectors, metrics and surrogates have the names of this program:
the paper's vans and cyclists are class Cyclist, its sum of classes is "all", recall is in percent.
Each figure is of one training. `TABLES` says which table a row is from.
"""

from importlib.resources import files

import pandas as pd

TABLES = {
    "detection": "object detection under LiDAR configurations",
    "roll": "roll of the LiDARs at the sides",
    "density": "traffic of three densities, Square",
    "recall": "recall under LiDAR configurations",
    "pitch_ap": "pitch of the front LiDARs, AP",
    "pitch_recall": "pitch of the front LiDARs, recall",
    "pedestrian": "pedestrian detection",
}
"""What the paper's tables with results show, by the value of column `table`."""


def published_detection() -> pd.DataFrame:
    """AP and recall: table, metric, class, iou, detector, placement, density, value (percent).

    `density` is dense, medium or sparse, and empty where the paper names none.
    """
    return _read("detection.csv")


def published_surrogates() -> pd.DataFrame:
    """S-MIG, H_POG and IG: table, class, placement, density, surrogate, value (nats)."""
    return _read("surrogate.csv")


def _read(name: str) -> pd.DataFrame:
    with files(__name__).joinpath(name).open(encoding="utf-8") as file:
        return pd.read_csv(file, keep_default_na=False)
