"""Write `shuttle.yaml`: the random rigs of a shuttle, with detectors for each.

Run as `python studies/proof/shuttle_rigs.py` after the command of `shuttle_space.yaml`.
"""

from pathlib import Path

import pandas as pd
import yaml

FOLDER = Path(__file__).parent
RIGS = 20
TESTS = {
    "scene.test_folder": [
        f"logs/{test}" for test in ("generated/sumo-911", "sparse/sumo-913", "carla/sumo-917")
    ]
}
AXES = ("x", "y", "z", "roll_deg", "pitch_deg", "yaw_deg")


def main() -> None:
    """Read the trials, whose lengths are metres, and write the file beside this one."""
    space = yaml.safe_load((FOLDER / "shuttle_space.yaml").read_text(encoding="utf-8"))
    search = space.pop("search")
    trials = pd.read_parquet(f"runs/{space['name']}/trials.parquet").query("feasible").head(RIGS)
    rigs = {
        f"random_{trial['number'] + 1}": _mounts(trial, search) for _, trial in trials.iterrows()
    }
    settings = space | {
        "name": "proof_shuttle",
        "vehicle": search["vehicle"],
        "mounting_errors": {"offset": 0.01, "angle_deg": 0.5},
        "detector": "pointpillars_tiny",
        "training": {"checkpoint": "pretrained", "epochs": 3, "rotation": 0.1},
        "placements": {name: {"mounts": mounts} for name, mounts in rigs.items()},
        "grid": {"placement": list(rigs), "evaluator": ["pretrained", "specialist"], "seed": [1]}
        | TESTS,
    }
    del settings["robustness"]
    content = yaml.safe_dump(settings, sort_keys=False, width=100, default_flow_style=None)
    command = "python studies/proof/shuttle_rigs.py"
    (FOLDER / "shuttle.yaml").write_text(f"# Made by `{command}`.\n{content}", encoding="utf-8")


def _mounts(trial: pd.Series, search: dict) -> list[dict[str, object]]:
    mounts = []
    for number in range(1, int(trial["lidars"]) + 1):
        lidar = trial.filter(like=f"lidar_{number}.").rename(lambda name: name.split(".")[1])
        pose = {axis: round(float(lidar.get(axis, lidar.get(f"{axis}_m"))), 3) for axis in AXES}
        mounts.append(pose | {"lidar": dict(search["models"][lidar["model"]])})
    return mounts


if __name__ == "__main__":
    main()
