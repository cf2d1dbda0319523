"""Writes `random.yaml`: rigs drawn at random, the population that a search meets.

A draw from the rigs of `candidates.yaml` that `findings.yaml` does not have; no predictor chooses
among them. Run as `python studies/findings/random_rigs.py`.
"""

from __future__ import annotations

import numpy as np
import yaml
from candidates import FOLDER, write

RIGS, SEED = 40, 40


def main() -> None:
    """Write the file to this folder."""
    drawn = yaml.safe_load((FOLDER / "candidates.yaml").read_text(encoding="utf-8"))["placements"]
    known = yaml.safe_load((FOLDER / "findings.yaml").read_text(encoding="utf-8"))["placements"]
    new = {name.replace("rig", "random"): rig for name, rig in drawn.items()}
    left = [name for name in new if name not in known]
    # Not the first: the candidates are in the order of the share of their rings that coincide.
    chosen = np.random.default_rng(SEED).choice(left, RIGS, replace=False)
    rigs = {name: new[name] for name in sorted(chosen.tolist())}
    settings = yaml.safe_load((FOLDER / "base.yaml").read_text(encoding="utf-8"))
    # Towns that neither the shipped weights nor the other rigs of this study have seen.
    settings["scene"] |= {"seed": 811, "test_routes": 32}
    settings |= {
        "mounting_errors": {"offset": 0.01, "angle_deg": 0.5},
        "detector": "pointpillars_tiny",
        "training": {"checkpoint": "pretrained", "epochs": 3, "rotation": 0.1},
        "placements": rigs,
        "grid": {
            "placement": ["center", *rigs],
            "evaluator": ["pretrained", "specialist"],
            "seed": [1, 2],
        },
        "exclude": [{"evaluator": "pretrained", "seed": 2}],
    }
    write(settings, FOLDER / "random.yaml", "python studies/findings/random_rigs.py")


if __name__ == "__main__":
    main()
