"""Car AP and the ranking of eight placements if a turn of the LiDARs takes time.

    lidarplace record traffic.yaml logs
    python benchmarks/studies/scan_time.py logs/sumo-11 --out scan_time.csv --every 2

`traffic.yaml` has the scene {seed: 11, density: 80, routes: 1, test_routes: 24, frames_per_route:
12, frame_stride: 10, egos_per_run: 2}, and otherwise what `examples/grid.yaml` has.

Every car of the test frames, and the vehicle itself, moves at one speed along its heading. So the
boxes at the moments of the frames, the labels, are the same at all speeds: a frame is replaced by
three, 0.1 s apart, of which the middle one is evaluated. The package's generalist evaluates the
paper's placements with LiDARs at 10 Hz: locked ahead, locked behind, where the scan then begins and
ends ahead, with free phases, and without compensation of the motion of the vehicle.

`--train logs/sumo-21` first fine-tunes the generalist for each condition and placement, on the
training frames of a log in which everything moves alike: of the scene {seed: 21, density: 80,
routes: 24, test_routes: 1, frames_per_route: 24, frame_stride: 10, egos_per_run: 2}.

Prints Car AP over IoU, the mean of the placements and its change, and Spearman's rho of the ranking
with that of a still world; with 95 % intervals of the jackknife over routes, paired."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
import typer
from numpy.typing import NDArray
from scipy.stats import spearmanr, t

from lidarplace import PAPER_PLACEMENTS, Lidar
from lidarplace.clouds.collect import SimulatedClouds, collect, crop_for
from lidarplace.clouds.surroundings import Surroundings
from lidarplace.clouds.visibility import ground_truth
from lidarplace.logs.box_log import BoxLog, read_box_log
from lidarplace.rigs.scan_timing import ScanTiming
from training.detect import Predictor
from training.finetune import TrainingContext, finetune
from training.kitti_ap import evaluation
from training.pretrained import read_generalist
from training.settings import TrainingSettings

STEP_S = 0.1
X, Y, Z = (0.0, 40.0), (-20.0, 20.0), (0.0, 4.0)
AHEAD, BEHIND, FREE = ScanTiming(10.0), ScanTiming(10.0, math.pi), ScanTiming(10.0, None)
CONDITIONS = {
    "0 m/s": (0.0, None),
    "30 m/s, locked ahead": (30.0, AHEAD),
    "30 m/s, free": (30.0, FREE),
    "15 m/s, locked ahead": (15.0, AHEAD),
    "15 m/s, free": (15.0, FREE),
    "30 m/s, locked behind": (30.0, BEHIND),
    "15 m/s, locked behind": (15.0, BEHIND),
    "30 m/s, locked ahead, not compensated": (30.0, replace(AHEAD, compensated=False)),
}


def at_speed(log: BoxLog, speed: float, split: str = "test") -> BoxLog:
    """The frames of a split, with one before and after each in which all cars move at `speed`."""
    frames = log.frames[log.frames["split"] == split]
    boxes = log.boxes[log.boxes["frame"].isin(frames["frame"])]
    tables: tuple[list[pd.DataFrame], list[pd.DataFrame]] = ([], [])
    for number in (-1, 0, 1):
        ahead, names = number * STEP_S * speed, {"route": frames["route"].astype(str)}
        moved = frames.assign(
            frame=3 * frames["frame"] + number,
            timestamp_s=frames["timestamp_s"] + number * STEP_S,
            ego_x=frames["ego_x"] + ahead * np.cos(frames["ego_yaw"]),
            ego_y=frames["ego_y"] + ahead * np.sin(frames["ego_yaw"]),
            **names,
        )
        way = ahead * (boxes["class"] == "Car")
        there = boxes.assign(
            frame=3 * boxes["frame"] + number,
            x=boxes["x"] + way * np.cos(boxes["yaw"]) - ahead,
            y=boxes["y"] + way * np.sin(boxes["yaw"]),
        )
        tables[0].append(moved)
        tables[1].append(there)
    both = (pd.concat(rows, ignore_index=True) for rows in tables)
    frames, boxes = both
    return replace(log, boxes=boxes, frames=frames)


def middle(log: BoxLog, every: int) -> pd.DataFrame:
    """Every so many of the frames of `at_speed` that have neighbours."""
    return log.frames[log.frames["frame"] % 3 == 0].iloc[::every]


def truths_of(log: BoxLog, frames: pd.DataFrame) -> pd.DataFrame:
    """The objects that count in some frames."""
    still = replace(log, boxes=log.boxes[log.boxes["frame"].isin(frames["frame"])], frames=frames)
    return ground_truth(still, X, Y, Z, seed=0)


def values(
    tested: tuple[BoxLog, pd.DataFrame],
    trained: tuple[BoxLog, pd.DataFrame] | None,
    timing: ScanTiming | None,
    placements: list[str] | None,
) -> pd.DataFrame:
    """Car AP over IoU of every placement, and without each route; of a log and some frames."""
    generalist = read_generalist()
    lidar = replace(Lidar.even(azimuth_steps=900, range_noise=0.02, drop_off=0.05), timing=timing)
    crop = crop_for(X, Y, Z, PAPER_PLACEMENTS["center"].with_lidar(lidar))
    log, frames = tested
    surroundings, truths, rows = Surroundings(log), truths_of(log, frames), []
    weights, settings = generalist.state_dict, TrainingSettings(epochs=3, rotation=0.1)
    context = TrainingContext(crop, generalist.typical, generalist=weights)
    network = generalist.detector, generalist.classes
    for name in placements or PAPER_PLACEMENTS:
        rig = PAPER_PLACEMENTS[name].with_lidar(lidar)
        if trained:
            clouds = collect(trained[0], trained[1]["frame"].to_numpy(), rig, crop)
            training = *network, clouds, truths_of(*trained), settings
            weights = finetune(*training, seed=1, context=context).state_dict
        test = SimulatedClouds(surroundings, frames["frame"].to_numpy(), rig, crop)
        boxes = Predictor(*network, weights, settings, crop, generalist.typical).detect(test).boxes
        left_out = evaluation(truths, boxes, frames, ["Car"]).left_out
        assert left_out is not None
        mean = left_out[left_out["metric"] == "AP_R40_3D_mean"]
        rows.append(mean[mean["unit"].isin(["route", "nothing"])].assign(placement=name))
    return pd.concat(rows, ignore_index=True)


def interval(value: float, without: NDArray[np.float64], most: float = math.inf) -> str:
    """A value with its 95 % interval, cut at `most`, by the values without each unit."""
    n = len(without)
    error = math.sqrt((n - 1) / n * np.square(without - without.mean()).sum())
    half = t.ppf(0.975, n - 1) * error
    return f"{value:.2f} ({value - half:.2f} to {min(value + half, most):.2f})"


def lines(table: pd.DataFrame) -> list[str]:
    """A row of a Markdown table for each condition."""
    pivot = table.pivot_table(values="value", index=["condition", "left_out"], columns="placement")
    still, rows = pivot.loc["0 m/s"], ["| | AP | change | rho | best |", "|---|---|---|---|---|"]
    for name in CONDITIONS:
        if name not in pivot.index.get_level_values(0):
            continue
        ap = pivot.loc[name].loc[still.index]
        mean, change = ap.mean(axis=1), (ap - still).mean(axis=1)
        rho = pd.Series({unit: spearmanr(ap.loc[unit], still.loc[unit])[0] for unit in ap.index})
        limits = ((mean, math.inf), (change, math.inf), (rho, 1.0))
        cells = [interval(s[""], s.drop("").to_numpy(), most) for s, most in limits]
        rows.append(f"| {name} | {' | '.join(cells)} | {ap.loc[''].idxmax()} |")
    return rows


def main(
    log: Path,
    out: Path = Path("scan_time.csv"),
    every: Annotated[int, typer.Option(help="frames between two that are evaluated")] = 1,
    train: Annotated[Path | None, typer.Option(help="log on which the generalist goes on")] = None,
    placement: Annotated[
        list[str] | None, typer.Option(help="of the paper's; default: all")
    ] = None,
    condition: Annotated[list[str] | None, typer.Option(help="after 0 m/s; default: all")] = None,
) -> None:
    recorded, tables = read_box_log(log), []
    learnt = read_box_log(train) if train else None
    for name, (speed, timing) in CONDITIONS.items():
        if speed and condition and name not in condition:
            continue
        moving = at_speed(recorded, speed)
        trained = at_speed(learnt, speed, "train") if learnt else None
        table = values(
            (moving, middle(moving, every)),
            (trained, middle(trained, every)) if trained else None,
            timing,
            placement,
        )
        tables.append(table.assign(condition=name))
        pd.concat(tables).to_csv(out, index=False)
        print("\n".join(lines(pd.concat(tables))), flush=True)


if __name__ == "__main__":
    typer.run(main)
