"""What towns, traffic and buildings give, and what they cost.

    OMP_NUM_THREADS=1 python benchmarks/studies/towns.py [TOWN …]

By default the generated town and CARLA's Town01, 03, 04 and 06. Each town is recorded with 40, 80
and 120 vehicles and 60 pedestrians: 8 egos in one run of 60 s at 20 Hz after 30 s of warm-up.
Objects are the boxes of a frame whose centre is in the full ROI of 80 x 40 m or in its front half:
all of them, and vehicles alone. `standing` is the share of vehicles below 0.1 m/s, red lights
included. CPU seconds cover everything from the map to the box log.
"""

from __future__ import annotations

import sys
import time

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from lidarplace.logs.box_log import BoxLog
from lidarplace.scenes.sumo.record import drive, record_town
from lidarplace.scenes.sumo.settings import GENERATED, SumoScene
from lidarplace.scenes.sumo.traffic import PEDESTRIAN
from lidarplace.scenes.sumo.trajectories import Trajectories

TOWNS = (GENERATED, "Town01", "Town03", "Town04", "Town06")
DENSITIES = (40, 80, 120)
EARLIER = {40: "4.9/2.8", 80: "6.5/3.6", 120: "8.3/4.5"}
"""Objects a frame, full/front, of a prototype in which up to two thirds of the cars stood still."""

STANDING_M_S = 0.1
NEAR_M = 50.0


def objects(log: BoxLog) -> list[float]:
    """Objects, objects in front, vehicles, vehicles in front; a frame."""
    boxes = log.boxes
    full = (boxes["x"].abs() <= 40) & (boxes["y"].abs() <= 20)
    front = full & (boxes["x"] >= 0)
    vehicle = boxes["class"] != PEDESTRIAN.object_class
    regions = (full, front, full & vehicle, front & vehicle)
    return [region.sum() / len(log.frames) for region in regions]


def standing_share(traffic: Trajectories) -> float:
    """Share of vehicles, over all steps, that stand."""
    vehicles = [user.kind is not PEDESTRIAN for user in traffic.users]
    return float(np.nanmean(traffic.speed[:, vehicles] < STANDING_M_S))


def buildings_near(log: BoxLog) -> float:
    """Buildings whose centre is within `NEAR_M` of the ego, mean over frames."""
    tree = cKDTree(log.buildings[["x", "y"]].to_numpy(np.float64))
    egos = log.frames[["ego_x", "ego_y"]].to_numpy(np.float64)
    return float(np.mean(tree.query_ball_point(egos, NEAR_M, return_length=True)))


def main() -> None:
    rows = []
    for density in DENSITIES:
        for town in sys.argv[1:] or TOWNS:
            scene = SumoScene(
                towns=(town,),
                density=density,
                pedestrians=60,
                test_routes=0,
                frames_per_route=1200,
                frame_stride=1,
            )
            (run,) = scene.town_runs()
            start = time.process_time()
            log = record_town(scene, run)
            seconds = time.process_time() - start
            _, _, traffic = drive(scene, run)
            rows.append(
                (
                    *(density, town, *objects(log), standing_share(traffic), buildings_near(log)),
                    *(len(log.frames) / seconds, 10_000 * seconds / len(log.frames)),
                )
            )
            print(*rows[-1], flush=True, file=sys.stderr)
    names = ["objects", "front", "vehicles", "v. front", "standing", "buildings < 50 m"]
    columns = ["density", "town", *names, "frames/s", "CPU s for 10,000"]
    table = pd.DataFrame(rows, columns=columns)
    print(table.round(2).to_string(index=False))
    print("\nMean over CARLA's towns; earlier figures are of a prototype")
    means = table[table["town"] != GENERATED].groupby("density")[names].mean().round(2)
    print(means.assign(earlier=means.index.map(EARLIER)).to_string())


if __name__ == "__main__":
    main()
