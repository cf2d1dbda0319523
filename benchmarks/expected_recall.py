"""Expected recall: milliseconds of CPU time a rig, and its error against frames and azimuth steps.

    lidarplace record examples/study.yaml logs
    OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 python benchmarks/expected_recall.py logs/sumo-1

Cars in the front ROI of the log's test frames, the paper's eight placements, and 96 candidate
mounts.
"""

from __future__ import annotations

import argparse
import itertools
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np
import pandas as pd

from lidarplace import PAPER_PLACEMENTS, ExpectedRecall, Lidar, Mount, Placement, Roi
from lidarplace.logs.box_log import BoxLog, read_box_log
from lidarplace.pog.selection import Limits
from lidarplace.recall.choice import RecallChoice
from lidarplace.recall.surface_cells import SurfaceCells

ROI = Roi(x=(0, 40), y=(-20, 20), z=(0, 4), resolution=0.1)
RIGS = list(PAPER_PLACEMENTS.values())
SHARES = {steps: steps / Lidar.paper().azimuth_steps for steps in (225, 450, 900, 1800, 5625)}
FRAMES = (10, 35, 70, 140)
DENSITY = 900

T = TypeVar("T")


def milliseconds(work: Callable[[], T], times: int = 1) -> tuple[float, T]:
    """Mean of so many calls, after one that compiles."""
    found = work()
    start = time.process_time()
    for _ in range(times):
        found = work()
    return 1e3 * (time.process_time() - start) / times, found


def candidates() -> list[Placement]:
    """Single mounts."""
    poses = itertools.product(
        *(np.linspace(*ends).tolist() for ends in ((-0.5, 0.5, 3), (-0.6, 0.6, 4), (2.2, 3.0, 2))),
        np.linspace(-0.28, 0.28, 4).tolist(),
    )
    mounts = [Mount(x=x, y=y, z=z, roll=roll) for x, y, z, roll in poses]
    return [Placement(str(n), [mount], lidar=Lidar.paper()) for n, mount in enumerate(mounts)]


def times(log: BoxLog, model: ExpectedRecall) -> None:
    ms, _ = milliseconds(lambda: ExpectedRecall.from_log(log, ROI, ["Car"]))
    print(f"objects that count: {ms:.0f} ms")
    casts = len(RIGS[0].mounts) * model.objects.table["frame"].nunique()
    for steps in (DENSITY, 5625):
        cast = ExpectedRecall.from_log(log, ROI, ["Car"], azimuth_share=SHARES[steps])
        ms, _ = milliseconds(lambda cast=cast: cast.objects.seen_by(RIGS[:1]))  # type: ignore[misc]
        print(f"{steps} azimuth steps: {ms:.0f} ms a rig, {ms / casts:.2f} ms a mount and frame")
    grid = candidates()
    ms, seen = milliseconds(lambda: model.objects.seen_by(grid))
    megabytes = sum(own.cells.nbytes + own.offsets.nbytes for own in seen) / 1e6
    print(f"{len(grid)} candidates: {ms:.0f} ms, {megabytes:.1f} MB")

    def known() -> float:
        rig: SurfaceCells = seen[5].and_(seen[40]).and_(seen[60]).and_(seen[95])
        return float(model.probabilities(rig).mean())

    print(f"a rig of four known mounts: {milliseconds(known, 100)[0]:.2f} ms")
    choice = RecallChoice(model, seen, {"Car": 1.0})
    ms, _ = milliseconds(lambda: choice.gains([5, 40]), 3)
    print(f"one LiDAR more, of {len(grid)}: {ms:.1f} ms")
    limits = Limits.at_most(4, len(grid))
    ms, found = milliseconds(lambda: choice.greedy(limits))
    bound = choice.upper_bound(limits, found.chosen, seconds=10.0)
    print(
        f"greedy choice of four: {ms:.0f} ms, {found.value:.4f}, no rig of these exceeds "
        f"{bound.value:.4f}, by gains alone {bound.by_gains:.4f}"
    )


def values(model: ExpectedRecall) -> pd.DataFrame:
    """Rows of `recall` of the class Car, one a placement."""
    rows = [model.recall(seen).loc["Car"] for seen in model.objects.seen_by(RIGS)]
    return pd.DataFrame(rows, index=list(PAPER_PLACEMENTS))


def errors(log: BoxLog) -> None:
    share = SHARES[DENSITY]
    whole = values(ExpectedRecall.from_log(log, ROI, ["Car"], azimuth_share=share))
    print(f"\n{whole.round(4).to_string()}\n")
    print("frames  objects  individuals  standard error  error  of differences  rho with all")
    for most in (*FRAMES, len(log.frames)):
        model = ExpectedRecall.from_log(log, ROI, ["Car"], frames=most, azimuth_share=share)
        found = values(model)
        off = found["expected_recall"] - whole["expected_recall"]
        print(
            f"{most:6}  {found['objects'].iloc[0]:7.0f}  {found['individuals'].iloc[0]:11.0f}  "
            f"{found['standard_error'].mean():14.4f}  {off.abs().mean():5.4f}  {off.std():14.4f}  "
            f"{_rho(found, whole):12.2f}"
        )
    print("\nazimuth steps  mean  rho with 5,625")
    by_steps = {
        steps: values(ExpectedRecall.from_log(log, ROI, ["Car"], azimuth_share=own))
        for steps, own in SHARES.items()
    }
    for steps, found in by_steps.items():
        mean = found["expected_recall"].mean()
        print(f"{steps:13}  {mean:.3f}  {_rho(found, by_steps[5625]):.2f}")


def _rho(one: pd.DataFrame, other: pd.DataFrame) -> float:
    return float(one["expected_recall"].corr(other["expected_recall"], method="spearman"))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("log", type=Path, help="folder of a box log")
    log = read_box_log(parser.parse_args().log)
    frames = log.frames[log.frames["split"] == "test"]
    log = BoxLog(log.boxes[log.boxes["frame"].isin(frames["frame"])], frames, log.buildings)
    times(log, ExpectedRecall.from_log(log, ROI, ["Car"], azimuth_share=SHARES[DENSITY]))
    errors(log)
