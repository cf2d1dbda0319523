"""CPU milliseconds of a training frame, by part.

    OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 python benchmarks/training_step.py [NETWORK …]
        [--against FOLDER] [--half]

Trains on the log of `sweeps/benchmark` under *line*, 900 azimuth steps, batches of four; the
generalist is a `pointpillars_tiny` of three classes on four rigs. Functions of the training are
timed where they are, without what they call of each other. `--against` trains with the code of
another checkout in turns with this one, which `--half` runs in 16-bit floats: with `--against .` it
compares these. Prints medians over steps as a Markdown table.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
import typer

NETWORKS = ("pointpillars_tiny", "second_tiny", "generalist")
CROP = (0.0, -20.0, 0.0, 40.0, 20.0, 4.0)
LOG = Path(__file__).parents[1] / "sweeps/benchmark/log"
FIRST_STEPS = 6
"""They compile."""


class Clock:
    """Seconds of CPU time of each part, step by step."""

    def __init__(self) -> None:
        self.steps: list[dict[str, float]] = []
        self._now: dict[str, float] = defaultdict(float)
        self._part, self._since = ["other"], time.process_time()

    def _tick(self) -> None:
        now = time.process_time()
        self._now[self._part[-1]] += now - self._since
        self._since = now

    def step(self, _: float) -> None:
        """A step of the training is done."""
        self._tick()
        self.steps.append(dict(self._now))
        self._now.clear()

    def watch(self, owner: Any, name: str, part: str) -> None:
        """Count what a function takes under `part`."""
        function = getattr(owner, name)

        def timed(*args: Any, **kwargs: Any) -> Any:
            self._tick()
            self._part.append(part)
            try:
                return function(*args, **kwargs)
            finally:
                self._tick()
                self._part.pop()

        setattr(owner, name, timed)


def one(network: str, frames: int, half: bool) -> list[dict[str, float]]:
    """Seconds of a frame by part, of every step of a training."""
    from lidarplace import PAPER_PLACEMENTS, Lidar
    from lidarplace.clouds.clouds import JoinedClouds
    from lidarplace.clouds.collect import collect
    from lidarplace.clouds.visibility import ground_truth
    from lidarplace.logs.box_log import read_box_log
    from training import augment, dataset, finetune, optimisation
    from training.detectors import pointpillars, second, voxel_detector
    from training.detectors.heads.anchor_head import AnchorHead
    from training.ground_truth_sampling import ObjectDatabase
    from training.settings import TrainingSettings

    torch.set_num_threads(1)
    log = read_box_log(LOG)
    own = log.frames.loc[log.frames["split"] == "train", "frame"].to_numpy(np.int64)[:frames]
    lidar = replace(Lidar.paper(), azimuth_steps=900, range_noise=0.02, drop_off=0.05)
    joint = network == "generalist"
    rigs = ("line", "center", "trapezoid", "pyramid") if joint else ("line",)
    clouds = [
        collect(log, own[n :: len(rigs)], PAPER_PLACEMENTS[rig].with_lidar(lidar), CROP)
        for n, rig in enumerate(rigs)
    ]
    classes = ("Car", "Cyclist", "Pedestrian") if joint else ("Car", "Cyclist")
    objects = ground_truth(log, (0, 40), (-20, 20), (0, 4))
    settings = TrainingSettings(epochs=2, batch_size=4, rotation=0.1)
    if half:
        settings = settings.model_copy(update={"mixed_precision": "everywhere"})

    clock = Clock()
    parts: list[tuple[Any, str, str]] = [
        (dataset.TrainingFrames, "__getitem__", "unpack"),
        (ObjectDatabase, "paste", "paste"),
        (augment, "moved", "move"),
        (augment, "within_range", "cut to the range"),
        (augment.Augmentation, "__call__", "shuffle"),
        (pointpillars.PointPillars, "_pillars", "pillars or voxels"),
        (voxel_detector, "voxelise", "pillars or voxels"),
        (pointpillars.PointPillars, "head_output", "backbone and head"),
        (second.Second, "head_output", "backbone and head"),
        (AnchorHead, "targets", "targets"),
        (AnchorHead, "loss", "loss"),
        (torch.Tensor, "backward", "backward"),
        (optimisation.Optimisation, "step", "optimiser"),
    ]
    for owner, function, part in parts:
        clock.watch(owner, function, part)
    options = {"point_range": CROP, "on_step": clock.step}
    context = getattr(
        finetune, "TrainingContext", None
    )  # older commits have its fields as arguments
    options = {"context": context(**options)} if context else options
    name = "pointpillars_tiny" if joint else network
    finetune.finetune(name, classes, JoinedClouds(clouds), objects, settings, seed=1, **options)
    return [{part: t / 4 for part, t in step.items()} for step in clock.steps[FIRST_STEPS:]]


def main(
    networks: Annotated[list[str] | None, typer.Argument(help=f"of {', '.join(NETWORKS)}")] = None,
    against: Annotated[Path | None, typer.Option(help="checkout to compare with")] = None,
    frames: int = 120,
    rounds: Annotated[int, typer.Option(min=1, help="trainings of each")] = 3,
    half: Annotated[bool, typer.Option("--half", help="16-bit floats in this checkout")] = False,
    child: Annotated[str | None, typer.Option(hidden=True)] = None,
) -> None:
    if child is not None:
        print(json.dumps(one(child, frames, half)))
        return
    before = [] if against is None else [(against.resolve(), False)]
    sides = [*before, (Path(__file__).parents[1], half)]
    for network in networks or NETWORKS:
        steps: list[list[dict[str, float]]] = [[] for _ in sides]
        for _ in range(rounds):
            for (folder, halved), found in zip(sides, steps, strict=True):
                command = [sys.executable, __file__, f"--frames={frames}", f"--child={network}"]
                command += ["--half"] if halved else []
                environment = os.environ | {"PYTHONPATH": str(folder)}
                ran = subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE)
                found += json.loads(ran.stdout.splitlines()[-1])
        names = list(dict.fromkeys(part for step in steps[-1] for part in step))
        columns = [
            [1e3 * float(np.median([step.get(part, 0) for step in found])) for part in names]
            for found in steps
        ]
        print(f"\n| {network}, ms a frame |{' before | after |' if against else ' |'}")
        print("|---|" + "---:|" * len(sides))
        for part, row in [*zip(names, zip(*columns, strict=True), strict=True),
                          ("together", [sum(column) for column in columns])]:  # fmt: skip
            print(f"| {part} | {' | '.join(f'{value:.2f}' for value in row)} |", flush=True)


if __name__ == "__main__":
    typer.run(main)
