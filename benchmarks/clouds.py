"""Bytes and milliseconds of a packed cloud, beside other ways to keep it.

    OMP_NUM_THREADS=1 python benchmarks/clouds.py runs/store/scene/*

Collects every `--every`-th frame of a box log under four of the paper's placements with 5,625
azimuth steps, 2 cm of range noise and 5 % drop-off, cut to the front ROI. Prints per frame: points,
milliseconds to collect, bytes and milliseconds to read (files in the page cache; minima of 5 runs).
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from lidarplace import PAPER_PLACEMENTS, Lidar
from lidarplace.clouds.clouds import read_clouds, write_clouds
from lidarplace.clouds.collect import collect
from lidarplace.logs.box_log import join_logs, read_box_log

CROP = (0.0, -20.0, -0.5, 40.0, 20.0, 4.0)
RUNS = 5


def fastest(run: Callable[[], object]) -> float:
    """Seconds of the fastest of `RUNS` runs."""
    best = np.inf
    for _ in range(RUNS):
        start = time.perf_counter()
        run()
        best = min(best, time.perf_counter() - start)
    return best


def main(logs: list[Path], every: Annotated[int, typer.Option(min=1)] = 50) -> None:
    log = join_logs([read_box_log(path) for path in logs])
    frames = log.frames["frame"].to_numpy(np.int64)[::every]
    lidar = replace(Lidar.paper(), range_noise=0.02, drop_off=0.05)
    print(f"{len(frames)} frames; per frame:")
    header = f"{'placement':12s}{'points':>9s}{'collected':>13s}"
    print(header + "".join(f"  {way:>18s}" for way in ("packed", "float32", "npz")))
    for name in ("line", "center", "pyramid", "line_roll"):
        placement = PAPER_PLACEMENTS[name].with_lidar(lidar)
        clouds = collect(log, frames, placement, CROP)
        casting = fastest(lambda placement=placement: collect(log, frames, placement, CROP))
        with tempfile.TemporaryDirectory() as folder:
            packed = Path(folder) / "packed"
            write_clouds(packed, clouds)
            for i, points in enumerate(clouds):
                np.save(packed / f"{i}.plain.npy", points)
                np.savez_compressed(packed / f"{i}.npz", points)
            of = [clouds.data.nbytes]
            of += [
                sum(path.stat().st_size for path in packed.glob(pattern))
                for pattern in ("*.plain.npy", "*.npz")
            ]
            seconds = [
                fastest(lambda packed=packed: list(read_clouds(packed))),
                fastest(lambda packed=packed: [np.load(p) for p in packed.glob("*.plain.npy")]),
                fastest(lambda packed=packed: [np.load(p)["arr_0"] for p in packed.glob("*.npz")]),
            ]
        cells = [
            f"{size / len(frames) / 1e3:7.0f} kB {s / len(frames) * 1e3:5.2f} ms"
            for size, s in zip(of, seconds, strict=True)
        ]
        points = f"{clouds.counts.sum() / len(frames):9,.0f}"
        print(f"{name:12s}{points}{casting / len(frames) * 1e3:10.1f} ms  " + "  ".join(cells))


if __name__ == "__main__":
    typer.run(main)
