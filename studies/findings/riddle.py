"""Writes `riddle.yaml`: in print *center* is the worst of the eight for many detectors; why?

What the released code does differently is tried alone and together, each by a generalist of its
own. Its misaligned heights give each rig another crop, which needs a detector of its own for each.
Run as `python studies/findings/riddle.py`.
"""

from __future__ import annotations

import yaml
from candidates import FOLDER, write

from lidarplace import PAPER_PLACEMENTS


def main() -> None:
    """Write the file beside this one."""
    settings = yaml.safe_load((FOLDER / "base.yaml").read_text(encoding="utf-8"))
    settings |= {
        "detector": "pointpillars_tiny",
        "evaluator": "generalist",
        "training": {"epochs": 6, "rotation": 0.1},
        "generalist": {"rigs": 32, "rigs_per_frame": 8, "epochs": 4},
        "grid": {
            "placement": list(PAPER_PLACEMENTS),
            "lidar.cloud_share": [0.16, 0.0444],  # 250 steps: its 4,000 rays a LiDAR
            "lidar.tilt_in_degrees": [False, True],
            "scene.split": ["route", "paper"],
            "mounting_errors.angle_deg": [0.0, 0.5],
            "seed": [1],
        },
    }
    del settings["lidar"]["cloud_share"]
    write(settings, FOLDER / "riddle.yaml", "python studies/findings/riddle.py")


if __name__ == "__main__":
    main()
