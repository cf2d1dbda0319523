"""Tables of the paper, to draw a sweep's own results next to them.

"Investigating the Impact of Multi-LiDAR Placement on Object Detection for Autonomous Driving",
CVPR 2022. Placements, classes, detectors, metrics and surrogates have the names of this program:
the paper's vans and cyclists are class Cyclist, its sum of classes is "all", recall is in percent.
Each figure comes from one training. `TABLES` says which table a row is from."""

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
"""Content of the paper's tables with results, by the value of column `table`."""


def published_detection() -> pd.DataFrame:
    """Read AP and recall: table, metric, class, iou, detector, placement, density, value (percent).

    `density` is dense, medium or sparse, and empty where the paper names none."""
    return _read("detection.csv")


def published_surrogates() -> pd.DataFrame:
    """Read S-MIG, H_POG and IG: table, class, placement, density, surrogate, value (nats)."""
    return _read("surrogate.csv")


def place3d_detection() -> pd.DataFrame:
    """Read AP of Place3D, "Is Your LiDAR Placement Optimized for 3D Scene Understanding?" (2024).

    From github.com/ywyeli/Place3D, README.md at dfeafe9, "3D Object Detection": detector,
    placement ("optimised" is theirs), class, value (percent). Bicycle is theirs, without trucks."""
    return _read("place3d_detection.csv")


def place3d_placements() -> pd.DataFrame:
    """Read Place3D's rigs, a row a LiDAR: placement, x, y, z, beams, lower_fov_deg, upper_fov_deg.

    From carla_nus/hyperparams/4x16.toml at 45fcb89, in CARLA's frame (y to the right), metres: a
    year younger than the AP, and without the poses of line_roll, pyramid_roll and "optimised"."""
    return _read("place3d_placements.csv")


def _read(name: str) -> pd.DataFrame:
    with files(__name__).joinpath(name).open(encoding="utf-8") as file:
        return pd.read_csv(file, keep_default_na=False)
