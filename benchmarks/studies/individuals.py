"""How many different road users a scene's frames hold, and what the choice of egos does to them.

    OMP_NUM_THREADS=1 python benchmarks/studies/individuals.py [CONFIG …]

By default examples/grid.yaml and examples/study.yaml. Counted are boxes whose centre is in the
ROI, of the classes of the configuration. `top ten` is the share of the boxes that the ten
individuals with most of them hold; `effective` is (sum n)² / sum n² of the boxes n of each. `empty`
is the share of frames without a box. CPU seconds are those of the whole scene, from the maps to the
box log.

Then, for the same simulations, the egos beside all cars that drove at least half the median
distance: road users within 40 m in a frame, mean speed, and the share of frames in which they
stand.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from lidarplace.logs.box_log import BoxLog
from lidarplace.scenes.sumo.record import choose_egos, drive, frames_met, record
from lidarplace.scenes.sumo.settings import SumoScene
from lidarplace.scenes.sumo.traffic import CAR
from lidarplace.scenes.sumo.trajectories import Trajectories

EXAMPLES = ("examples/grid.yaml", "examples/study.yaml")
STANDING_M_S = 0.1


def individuals(log: BoxLog, config: dict) -> pd.DataFrame:
    """One row a class and split."""
    boxes = log.boxes.merge(log.frames[["frame", "split"]], on="frame")
    for axis, (low, high) in config["roi"].items():
        boxes = boxes[boxes[axis].between(low, high)]
    rows = []
    for object_class in config["classes"]:
        for split, frames in log.frames.groupby("split", sort=False)["frame"]:
            mine = boxes[(boxes["split"] == split) & (boxes["class"] == object_class)]
            n = mine["object_id"].value_counts()
            rows.append(
                {
                    "class": object_class,
                    "split": split,
                    "frames": len(frames),
                    "boxes": n.sum(),
                    "individuals": len(n),
                    "top ten": n.head(10).sum() / n.sum(),
                    "effective": n.sum() ** 2 / (n**2).sum(),
                    "empty": 1 - mine["frame"].nunique() / len(frames),
                }
            )
    return pd.DataFrame(rows)


def around(traffic: Trajectories, egos: list[int]) -> tuple[float, float, float]:
    """Road users near an ego in a frame, metres per second, share of frames in which it stands."""
    met = [frames_met(traffic, ego).sum() / len(traffic.time_s) for ego in egos]
    speed = traffic.speed[:, egos]
    return float(np.mean(met)), float(speed.mean()), float((speed < STANDING_M_S).mean())


def driving(traffic: Trajectories) -> list[int]:
    """The cars that were on the road all the time and drove at least half the median distance."""
    stayed = ~np.isnan(traffic.speed.sum(axis=0))
    cars = [u for u, user in enumerate(traffic.users) if user.kind is CAR and stayed[u]]
    distance = traffic.speed[:, cars].sum(axis=0)
    return np.array(cars)[distance >= np.median(distance) / 2].tolist()


def main() -> None:
    for path in sys.argv[1:] or EXAMPLES:
        config = yaml.safe_load(Path(path).read_text())
        scene = SumoScene(**config["scene"])
        start = time.process_time()
        log = record(scene)
        seconds = time.process_time() - start
        print(f"{path}: {seconds:.1f} CPU s")
        print(individuals(log, config).round(2).to_string(index=False))
        rows = []
        for run in scene.town_runs():
            _, _, traffic = drive(scene, run)
            egos = choose_egos(traffic, run.routes)
            rows.append((*around(traffic, egos), *around(traffic, driving(traffic))))
        columns = [f"{what}, {who}" for who in ("egos", "all") for what in ("near", "m/s", "stand")]
        print(pd.DataFrame(rows, columns=columns).mean().round(2).to_string(), "\n")


if __name__ == "__main__":
    main()
