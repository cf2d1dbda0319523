"""CPU milliseconds of clouds of LiDARs that take time for a frame, beside those of a still world.

    python benchmarks/scan_time.py logs/sumo-11

*line_roll*, front ROI, every `--every`-th frame, in turn in one process: mean over frames of the
least of `REPEATS`. `casting` is that of all four LiDARs.
"""

from __future__ import annotations

import time
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from lidarplace import PAPER_PLACEMENTS, Lidar
from lidarplace.clouds.collect import SimulatedClouds, crop_for
from lidarplace.clouds.surroundings import Surroundings
from lidarplace.logs.box_log import read_box_log
from lidarplace.rigs.scan_timing import ScanTiming

REPEATS = 5


def main(log: Path, every: Annotated[int, typer.Option(min=1)] = 60) -> None:
    """Print a line for each number of azimuth steps."""
    box_log = read_box_log(log)
    surroundings, numbers = Surroundings(box_log), box_log.frames["frame"].to_numpy()[::every]
    for steps in (5625, 900):
        lidar = Lidar.even(azimuth_steps=steps, range_noise=0.02, drop_off=0.05)
        clouds = {}
        for name, timing in (("off", None), ("on", ScanTiming(10.0))):
            rig = PAPER_PLACEMENTS["line_roll"].with_lidar(replace(lidar, timing=timing))
            crop = crop_for((0, 40), (-20, 20), (0, 4), rig)
            clouds[name] = SimulatedClouds(surroundings, numbers, rig, crop)
        spent: dict[tuple[str, str], list[float]] = defaultdict(list)
        for index, frame in enumerate(numbers.tolist()):
            runs: dict[tuple[str, str], list[float]] = defaultdict(list)
            for _ in range(1 + REPEATS):  # the first compiles
                for name, simulated in clouds.items():
                    scene, start = simulated.scene(index), time.process_time()
                    for number in range(len(scene.rig.mounts)):
                        simulated._cast(scene, number, (0, frame, number))
                    middle = time.process_time()
                    simulated.returns(index)
                    runs["casting", name].append(middle - start)
                    runs["cloud", name].append(time.process_time() - middle)
            for key, seconds in runs.items():
                spent[key].append(1e3 * min(seconds[1:]))
        for part in ("casting", "cloud"):
            off, on = (float(np.mean(spent[part, name])) for name in ("off", "on"))
            print(f"{steps} azimuth steps, {part}: {off:.2f} -> {on:.2f} ms, {on / off:.1f} times")


if __name__ == "__main__":
    typer.run(main)
