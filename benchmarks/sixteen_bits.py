"""Ranks of rigs by detections in bfloat16 and in 32-bit floats, by the same weights.

    OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 python benchmarks/sixteen_bits.py [WEIGHTS] [--every 8]

The 41 rigs and the test frames of `lidarplace benchmark`, the generalist of the package. Prints a
Markdown table: Spearman's rho, the mean over rigs of the difference with its 95 % interval, and the
largest difference, in points; and CPU seconds of the detections of 280 frames.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
import torch
import typer

from sweeps.benchmark.rigs import METRICS, log_of, of, trials
from sweeps.plan.trial import with_detector
from sweeps.search.trials.by_generalist import detect_task
from training.checkpoints import read_checkpoint
from training.detect import detect
from training.device import cpu_has_bfloat16
from training.kitti_ap import evaluation
from training.settings import PRETRAINED


def main(
    weights: Annotated[Path, typer.Argument(help="of lidarplace pretrain")] = PRETRAINED,
    every: Annotated[int, typer.Option(min=1, help="one of so many test frames")] = 8,
    rigs: Annotated[int, typer.Option(min=3, help="at most")] = 41,
) -> None:
    if not cpu_has_bfloat16():
        raise SystemExit("this processor has neither AVX512-BF16 nor AMX")
    torch.set_num_threads(1)
    content, _ = read_checkpoint(weights)
    log = log_of("test")
    frames = np.sort(log.frames["frame"].to_numpy(np.int64))[::every]
    log = replace(
        log,
        frames=log.frames[log.frames["frame"].isin(frames)],
        boxes=log.boxes[log.boxes["frame"].isin(frames)],
    )
    judged = with_detector(trials([f"detector={content['detector']}"]).values())[:rigs]
    truth = judged[0].ground_truths[0].stage.run(log).objects
    rows, seconds = [], []
    for trial in judged:
        params = detect_task(trial.evaluate, 0, 1).stage
        clouds = params.collection.simulated(log).kept()
        for floats in (False, "everywhere"):
            settings = params.training.model_copy(update={"mixed_precision": floats})
            start = time.process_time()
            found = detect(
                params.detector,
                content["classes"],
                content["model_state"],
                clouds,
                settings,
                point_range=params.point_range,
                typical=params.typical,
            )
            seconds.append((time.process_time() - start) * 280 / len(frames))
            table = evaluation(truth, found.boxes, frames.tolist(), params.classes).metrics
            rows.append({name: float(of(table, name)["value"].iloc[0]) for name in METRICS})
    full, half = pd.DataFrame(rows[::2]), pd.DataFrame(rows[1::2])
    print(f"{len(judged)} rigs, {len(frames)} frames\n")
    print("| | rho | difference | largest |\n|---|---:|---:|---:|")
    for name in METRICS:
        rho = full[name].corr(half[name], method="spearman")
        moved = half[name] - full[name]
        error = 1.96 * float(np.std(moved, ddof=1)) / math.sqrt(len(moved))
        print(
            f"| {name} | {rho:.3f} | {moved.mean():+.2f} ± {error:.2f} | {moved.abs().max():.1f} |"
        )
    print(f"\nseconds: {np.median(seconds[::2]):.2f}, in bfloat16 {np.median(seconds[1::2]):.2f}")


if __name__ == "__main__":
    typer.run(main)
