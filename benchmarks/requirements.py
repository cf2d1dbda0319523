"""Requirements a second: ten of them for the paper's rigs, every LiDAR dead once.

    OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 python benchmarks/requirements.py

Pedestrians within 5 m of a car at 0.25 m, in four headings, and others; positions, objects and
milliseconds of CPU time a rig, after one call that compiles. Other work on the machine adds little.
Then how much more rays hit of a box than of what stands in it in simulated clouds.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import pandas as pd

from lidarplace import PAPER_PLACEMENTS
from lidarplace.base.sectors import SECTORS, bounds_of
from lidarplace.clouds.own_body import body_parts
from lidarplace.clouds.shapes import shapes_of
from lidarplace.logs.boxes import CLASSES, GEOMETRY
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.recall.detection_curve import CELL_M, IOU, default_curves
from lidarplace.recall.surface_cells import ObjectFrames, SurfaceCells, slices_of, surface_cells
from lidarplace.requirements.area import Area
from lidarplace.requirements.check_requirements import check_requirements
from lidarplace.requirements.layout import lay_out
from lidarplace.requirements.rays_on_objects import count_cells, count_points, sights_of
from lidarplace.requirements.requirement import STANDARD, AlsoWhen, Requirement
from lidarplace.requirements.settings import preset

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
    check_requirements(laid, rigs[0], CAR)
    whole = 0.0
    print(f"{'requirement':14s}{'positions':>11s}{'objects':>9s}{'ms a rig':>10s}")
    for own in laid:
        start = time.process_time()
        for rig in rigs:
            check_requirements([own], rig, CAR)
        seconds = time.process_time() - start
        whole += seconds
        objects = 0 if own.roi else int((own.boxes[:, :, 0] < float("inf")).sum())
        print(
            f"{own.requirement.name:14s}{own.positions.held.sum():11,d}{objects:9,d}"
            f"{1e3 * seconds / len(rigs):10.0f}"
        )
    print(f"{len(laid) * len(rigs) / whole:.1f} requirements a second")


def boxes_and_shapes(number: int = 200) -> None:
    """Points and cells of boxes, in terms of those of the shapes that clouds are made of."""
    rng, rig, body = np.random.default_rng(0), PAPER_PLACEMENTS["line"], body_parts(None)
    sights = sights_of(rig, CAR)
    everywhere = (-99.0, -99.0, -9.0, 99.0, 99.0, 9.0)
    for name in CLASSES:
        own = STANDARD[name]
        away, azimuth = rng.uniform(8.0, 40.0, number), rng.uniform(-np.pi, np.pi, number)
        points = np.stack([away * np.cos(azimuth), away * np.sin(azimuth)], axis=1)
        boxes = own.boxes(points, 0.0)
        boxes[:, 6] = rng.uniform(0.0, np.pi, number)
        table = pd.DataFrame(boxes, columns=list(GEOMETRY)).assign(
            object_id=[f"{name} {n}" for n in range(number)], **{"class": name}
        )
        shapes = shapes_of(table)
        parts = [shapes.parts(np.array([row]), boxes[[row]]) for row in range(number)]
        alone = ObjectFrames(
            parts=np.concatenate([body.and_(one).geometry for one in parts]),
            owner=np.concatenate(
                [np.append(body.owner, one.owner + row) for row, one in enumerate(parts)]
            ).astype(np.int32),
            reflectivity=np.concatenate([body.and_(one).reflectivity for one in parts]),
            first_part=np.cumsum([0, *(len(body) + len(one) for one in parts)]),
            first_object=np.arange(number + 1),
            near=np.tile(everywhere, (number, 1)),
            geometry=boxes,
            slices=slices_of(boxes, CELL_M),
        )
        found = SurfaceCells.none(number)
        for mount, lidar in zip(rig.mounts, rig.lidars, strict=True):
            found = found.and_(surface_cells(mount, lidar, alone, everywhere, CELL_M))
        seen = found.points.sum(), found.counts().sum()
        of_boxes = (count_points(sights, boxes).sum(), count_cells(sights, boxes, CELL_M).sum())
        print(f"{name}: {of_boxes[0] / seen[0]:.2f} points, {of_boxes[1] / seen[1]:.2f} cells")


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__.partition("\n")[0]).parse_args()
    main()
    boxes_and_shapes()
