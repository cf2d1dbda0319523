"""Seconds of the KITTI evaluation of 3,769 frames, the size of KITTI's val split, on one core.

    NUMBA_NUM_THREADS=1 python benchmarks/kitti_evaluation.py

About KITTI's density: 4 objects, a Van or DontCare region and `--detections` detections a frame,
half of them near an object. Compiles first; prints the fastest of 3 runs.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Annotated

import numpy as np
import pandas as pd
import typer

from lidarplace.logs.boxes import GEOMETRY
from training.kitti_ap import evaluate_boxes, evaluate_detections
from training.kitti_labels import boxes_z_up

FRAMES, OBJECTS, OTHERS, RUNS = 3769, 4, 1, 3
CLASSES = ("Car", "Pedestrian", "Cyclist")
SIZES = {"Car": (1.6, 1.7, 4.0), "Pedestrian": (1.75, 0.6, 0.8), "Cyclist": (1.75, 0.6, 1.8)}
STRICT = {"Car": 0.7, "Pedestrian": 0.5, "Cyclist": 0.5}


def main(detections: Annotated[int, typer.Option(min=1)] = 20) -> None:
    random = np.random.default_rng(0)
    truth = _labels(random, FRAMES, OBJECTS)
    found = _detections(random, truth, detections)
    others = _labels(random, FRAMES, OTHERS)
    others["class"] = random.choice(["Van", "DontCare"], len(others))
    labels = pd.concat([truth, others])
    print(f"{FRAMES} frames, {len(labels)} labels, {len(found)} detections:")
    frames = range(FRAMES)
    seconds = _fastest(lambda: evaluate_detections(labels, found, FRAMES, STRICT))
    print(f"evaluate_detections, 3 classes, 3 difficulties: {seconds:6.2f} s")
    ego = _in_ego_frame(truth), _in_ego_frame(found)
    seconds = _fastest(lambda: evaluate_boxes(*ego, frames, CLASSES))
    print(f"evaluate_boxes, 3 classes:                      {seconds:6.2f} s")


def _fastest(run: Callable[[], object]) -> float:
    run()
    best = np.inf
    for _ in range(RUNS):
        start = time.perf_counter()
        run()
        best = min(best, time.perf_counter() - start)
    return best


def _labels(random: np.random.Generator, frames: int, per_frame: int) -> pd.DataFrame:
    """Objects on the road before the camera, with boxes in the image of about their size."""
    count = frames * per_frame
    name = random.choice(CLASSES, count, p=[0.8, 0.15, 0.05])
    height, width, length = np.array([SIZES[key] for key in name]).T
    z = random.uniform(5, 70, count)
    table = pd.DataFrame({"frame": np.repeat(np.arange(frames), per_frame), "class": name})
    table["truncated"], table["occluded"] = 0.0, random.integers(0, 4, count)
    table["alpha"] = random.uniform(-np.pi, np.pi, count)
    middle, tall = random.uniform(0, 1242, count), 720 * height / z
    for key, value in (("left", middle - tall), ("right", middle + tall)):
        table[key] = value
    table["top"], table["bottom"] = 180.0, 180 + tall
    table["height"], table["width"], table["length"] = height, width, length
    table["x"], table["y"], table["z"] = random.uniform(-20, 20, count), 1.6, z
    table["rotation_y"] = random.uniform(-np.pi, np.pi, count)
    return table


def _detections(random: np.random.Generator, truth: pd.DataFrame, per_frame: int) -> pd.DataFrame:
    """Half of them objects with errors, the others anywhere."""
    near = truth.groupby("frame").sample(per_frame // 2, replace=True, random_state=0)
    for key, error in (("x", 0.2), ("z", 0.2), ("rotation_y", 0.1), ("left", 5), ("bottom", 5)):
        near[key] += random.normal(0, error, len(near))
    found = pd.concat([near, _labels(random, FRAMES, per_frame - per_frame // 2)])
    found["score"] = random.random(len(found))
    return found


def _in_ego_frame(labels: pd.DataFrame) -> pd.DataFrame:
    return labels.assign(**dict(zip(GEOMETRY, boxes_z_up(labels).T, strict=True)))


if __name__ == "__main__":
    typer.run(main)
