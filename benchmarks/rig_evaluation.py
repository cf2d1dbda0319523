"""Seconds to evaluate a rig with a trained detector, beside those of training one from scratch.

    lidarplace record examples/study.yaml logs/study
    OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 python benchmarks/rig_evaluation.py logs/study/*

LiDARs, ROI, classes and detector of examples/study.yaml. A detector is trained from scratch on the
training frames under *line*, then the test frames are evaluated under four other placements: clouds
simulated and thrown away, boxes detected in them, AP and recall. Prints frames a second of each
part, seconds a rig and rigs an hour, the fastest of the four placements, and the same of the
training with its clouds. Seconds are of CPU time: other work on the machine adds little.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, TypeVar

import numpy as np
import torch
import typer

from lidarplace import PAPER_PLACEMENTS, Lidar
from lidarplace.clouds.collect import SimulatedClouds, collect, crop_for
from lidarplace.clouds.visibility import ground_truth
from lidarplace.logs.box_log import BoxLog, join_logs, read_box_log
from lidarplace.rigs.placement import Placement
from training.detect import detect
from training.finetune import TrainingContext, finetune
from training.kitti_ap import evaluate_boxes
from training.settings import TrainingSettings

CLASSES = ("Car", "Cyclist")
X, Y, Z = (0.0, 40.0), (-20.0, 20.0), (0.0, 4.0)
LIDAR = replace(Lidar.paper(), azimuth_steps=900, range_noise=0.02, drop_off=0.05)
RIGS = ("center", "trapezoid", "line_roll", "pyramid")

Result = TypeVar("Result")


def timed(part: Callable[[], Result]) -> tuple[Result, float]:
    """What `part` gives, and its seconds of CPU time: those of a core without other work."""
    start = time.process_time()
    result = part()
    return result, time.process_time() - start


def placement(name: str) -> Placement:
    """A placement of the paper with the study's LiDARs."""
    return PAPER_PLACEMENTS[name].with_lidar(LIDAR)


def numbers(log: BoxLog, split: str, most: int) -> np.ndarray:
    """The first frames of a split."""
    return log.frames.loc[log.frames["split"] == split, "frame"].to_numpy(np.int64)[:most]


def main(
    logs: list[Path],
    frames: Annotated[int, typer.Option(min=1, help="test frames of a rig, at most")] = 280,
    epochs: Annotated[int, typer.Option(min=1, help="of the training; the study has 6")] = 2,
    detector: str = "pointpillars_tiny",
) -> None:
    torch.set_num_threads(1)
    log = join_logs([read_box_log(path) for path in logs])
    objects = ground_truth(log, X, Y, Z)
    objects = objects[objects["class"].isin(CLASSES)]
    settings = TrainingSettings(epochs=epochs, rotation=0.1)

    learnt = numbers(log, "train", len(log.frames))
    crop = crop_for(X, Y, Z, placement("line"))
    clouds, collecting = timed(lambda: collect(log, learnt, placement("line"), crop))
    own = objects[objects["frame"].isin(learnt)]
    trained, training = timed(
        lambda: finetune(detector, CLASSES, clouds, own, settings, 1, TrainingContext(crop))
    )

    test = numbers(log, "test", frames)
    truths = objects[objects["frame"].isin(test)]
    fastest = dict.fromkeys(("clouds", "inference", "AP and recall", "together"), math.inf)
    for name in ("line", *RIGS):  # the first one compiles
        simulated = SimulatedClouds(log, test, placement(name), crop)
        _, casting = timed(lambda simulated=simulated: [len(cloud) for cloud in simulated])  # type: ignore[misc]
        found, detecting = timed(
            lambda simulated=simulated: (
                detect(  # type: ignore[misc]
                    detector, CLASSES, trained.state_dict, simulated, settings, point_range=crop
                ).boxes
            )
        )
        table, scoring = timed(
            lambda found=found: evaluate_boxes(truths, found, test.tolist(), CLASSES)  # type: ignore[misc]
        )
        if name == "line":
            continue
        parts = (casting, detecting - casting, scoring, detecting + scoring)
        for key, seconds in zip(fastest, parts, strict=True):
            fastest[key] = min(fastest[key], seconds)
        recall = table[(table["metric"] == "recall") & (table["class"] == "all")]["value"].iloc[0]
        print(f"{name:10s} recall @ 0.5 {recall:.1f}", flush=True)

    print(f"\n{'':28s}{'frames':>8s}{'frames/s':>10s}{'seconds':>9s}{'an hour':>9s}")
    rows = [(f"a rig: {key}", len(test), seconds) for key, seconds in fastest.items()]
    rows += [
        ("from scratch: clouds", len(learnt), collecting),
        (f"from scratch: {epochs} epochs", epochs * len(learnt), training),
    ]
    for key, count, seconds in rows:
        speed = f"{count / seconds:10,.0f}{seconds:9.2f}{3600 / seconds:9,.0f}"
        print(f"{key:28s}{count:8,d}{speed}")


if __name__ == "__main__":
    typer.run(main)
