"""Requirements a second: ten of them for the paper's rigs, every LiDAR dead once.

    OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 python benchmarks/requirements.py

Pedestrians within 5 m of a car at 0.25 m, in four headings, and others; positions, objects and
milliseconds of CPU time a rig, after one call that compiles. Other work on the machine adds little.
"""

from __future__ import annotations

import argparse
import time

from lidarplace import PAPER_PLACEMENTS
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.recall.detection_curve import IOU, default_curves
from lidarplace.requirements.area import Area
from lidarplace.requirements.judge import judge
from lidarplace.requirements.layout import lay_out
from lidarplace.requirements.placed_object import STANDARD
from lidarplace.requirements.presets import preset
from lidarplace.requirements.requirement import AlsoWhen, Requirement
from lidarplace.sectors import SECTORS, bounds_of

CAR = Vehicle.car()
DEAD = AlsoWhen(one_lidar_dead=True)


def requirements() -> list[Requirement]:
    """Ten, of all measures."""
    person, child = STANDARD["Pedestrian"], STANDARD["child"]
    cyclist, car = STANDARD["Cyclist"], STANDARD["Car"]
    around, curves = Area(distance=(0.3, 5.0)), default_curves()
    lanes = Area(x=(-20.0, 20.0), y=((-5.25, -1.75), (1.75, 5.25)))
    front = Area(distance=(5.0, 30.0), sectors=(bounds_of(SECTORS.index("front")),))
    return [
        Requirement("pedestrians", around, "points", 10, person, also_when=DEAD),
        Requirement("children", around, "points", 10, child, also_when=DEAD),
        Requirement("cells", around, "cells", 5, person, also_when=DEAD),
        Requirement(
            "probability",
            around,
            "probability",
            0.5,
            person,
            curve=curves.of("Pedestrian", IOU),
            also_when=DEAD,
        ),
        Requirement("UN R151", preset("un_r151", CAR), "points", 10, cyclist, also_when=DEAD),
        Requirement("UN R158", preset("un_r158", CAR), "points", 10, child, also_when=DEAD),
        Requirement("UN R159", preset("un_r159", CAR), "points", 10, person, also_when=DEAD),
        Requirement("lanes", lanes, "points", 20, car, step=0.5, also_when=DEAD),
        Requirement("ahead", front, "points", 5, person, step=0.5, also_when=DEAD),
        Requirement("ground", Area(distance=(0.0, 3.0)), "coverage", 0.8, also_when=DEAD),
    ]


def main() -> None:
    laid = [lay_out(wanted, CAR) for wanted in requirements()]
    rigs = list(PAPER_PLACEMENTS.values())
    judge(laid, rigs[0], CAR)
    whole = 0.0
    print(f"{'requirement':14s}{'positions':>11s}{'objects':>9s}{'ms a rig':>10s}")
    for own in laid:
        start = time.process_time()
        for rig in rigs:
            judge([own], rig, CAR)
        seconds = time.process_time() - start
        whole += seconds
        objects = 0 if own.roi else int((own.boxes[:, :, 0] < float("inf")).sum())
        print(
            f"{own.requirement.name:14s}{own.positions.held.sum():11,d}{objects:9,d}"
            f"{1e3 * seconds / len(rigs):10.0f}"
        )
    print(f"{len(laid) * len(rigs) / whole:.1f} requirements a second")


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__.partition("\n")[0]).parse_args()
    main()
