"""How much of the class Car the intensity alone gives away in simulated clouds.

    python benchmarks/studies/intensity.py logs/sumo-1

Collects every `--every`-th frame of a box log without range noise, cut to the front ROI. A point
within a box belongs to its object, all others are background. Prints, per placement:

- of the cars with points, how many have one that is brighter than all background of their frame;
- how well a threshold on the intensity of a point tells cars from all background, and from what of
  it stands upright (walls and signs);
- the same for the brightest point of a car, against the brightest of every square of 4 m of the
  background, and of those where something stands.

Each as the area under the ROC curve (0.5 is chance) and the best mean of the two classes' accuracy.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from lidarplace import PAPER_PLACEMENTS, Lidar
from lidarplace.clouds.collect import collect
from lidarplace.logs.box_log import BoxLog, join_logs, read_box_log
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.rigs.placement import Placement

CROP = (0.0, -20.0, -0.5, 40.0, 20.0, 4.0)
SQUARE_M = 4.0
MARGIN_M = 0.01
"""Boxes are grown by this, so that rounded coordinates stay inside."""


def owners(points: NDArray[np.float32], boxes: NDArray[np.float64]) -> NDArray[np.int64]:
    """Row of the box that holds each point above the ground, -1 for none; (n, 4) to (n,)."""
    owner = np.full(len(points), -1)
    for row, (x, y, z, length, width, height, yaw) in enumerate(boxes):
        dx, dy, dz = points[:, 0] - x, points[:, 1] - y, points[:, 2] - z
        along, aside = np.cos(yaw) * dx + np.sin(yaw) * dy, np.cos(yaw) * dy - np.sin(yaw) * dx
        inside = np.abs(along) <= length / 2 + MARGIN_M
        inside &= np.abs(aside) <= width / 2 + MARGIN_M
        inside &= (np.abs(dz) <= height / 2 + MARGIN_M) & (points[:, 2] > MARGIN_M)
        owner[inside] = row
    return owner


def separation(cars: NDArray[np.float64], others: NDArray[np.float64]) -> tuple[float, float]:
    """Area under the ROC curve, ties counted half, and best balanced accuracy of a threshold."""
    values = np.unique(np.concatenate([cars, others]))
    above = [1 - np.searchsorted(np.sort(part), values) / len(part) for part in (cars, others)]
    hit, alarm = (np.append(rate, 0.0) for rate in above)
    area = float(-np.trapezoid(hit, alarm))
    return area, float(0.5 + 0.5 * np.abs(hit - alarm).max())


def brightest(values: NDArray[np.float64], groups: NDArray[np.int64]) -> NDArray[np.float64]:
    """Largest value of each group that occurs."""
    if not len(values):
        return values
    order = np.argsort(groups, kind="stable")
    _, first = np.unique(groups[order], return_index=True)
    return np.maximum.reduceat(values[order], first)


def measure(log: BoxLog, frames: NDArray[np.int64], placement: Placement) -> dict[str, float]:
    """The figures that are printed, of one placement."""
    clouds = collect(log, frames, placement, CROP)
    car, ground, upright, cars, outshine = [], [], [], [], []
    squares, walls = [], []
    for frame, points in zip(frames, clouds, strict=True):
        boxes = log.boxes[log.boxes["frame"] == frame]
        owner = owners(points, boxes[list(GEOMETRY)].to_numpy(np.float64))
        of_car = np.append((boxes["class"] == "Car").to_numpy(), False)[owner]
        background = owner < 0
        light = points[:, 3].astype(np.float64)
        low = points[:, 2] <= MARGIN_M
        car.append(light[of_car])
        ground.append(light[background & low])
        upright.append(light[background & ~low])
        square = np.floor(points[:, :2] / SQUARE_M).astype(np.int64) @ [1000, 1]
        squares.append(brightest(light[background], square[background]))
        stands = background & np.isin(square, square[background & ~low])
        walls.append(brightest(light[stands], square[stands]))
        if of_car.any():
            cars.append(brightest(light[of_car], owner[of_car]))
            outshine.append(cars[-1] > light[background].max(initial=0.0))
    on_car, standing = np.concatenate(car), np.concatenate(upright)
    everything = np.concatenate([standing, *ground])
    area, accuracy = separation(on_car, everything)
    upright_area, upright_accuracy = separation(on_car, standing)
    brightest_cars = np.concatenate(cars)
    square_area, square_accuracy = separation(brightest_cars, np.concatenate(squares))
    wall_area, wall_accuracy = separation(brightest_cars, np.concatenate(walls))
    return {
        "cars": len(brightest_cars),
        "brighter than all background": float(np.concatenate(outshine).mean()),
        "point: area": area,
        "point: accuracy": accuracy,
        "point, upright: area": upright_area,
        "point, upright: accuracy": upright_accuracy,
        "brightest: area": square_area,
        "brightest: accuracy": square_accuracy,
        "brightest, upright: area": wall_area,
        "brightest, upright: accuracy": wall_accuracy,
    }


def main(logs: list[Path], every: Annotated[int, typer.Option(min=1)] = 10) -> None:
    log = join_logs([read_box_log(path) for path in logs])
    frames = log.frames["frame"].to_numpy(np.int64)[::every]
    lidar = replace(Lidar.paper(), range_noise=0.0, drop_off=0.0)
    names = ("line", "center", "pyramid", "line_roll")
    found = [measure(log, frames, PAPER_PLACEMENTS[name].with_lidar(lidar)) for name in names]
    print(f"{len(frames)} frames{'':21s}" + "".join(f"{name:>11s}" for name in names))
    for what in found[0]:
        form = "11,.0f" if what == "cars" else "11.1%" if "all" in what else "11.3f"
        print(f"{what:31s}" + "".join(format(figures[what], form) for figures in found))


if __name__ == "__main__":
    typer.run(main)
