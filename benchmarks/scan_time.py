"""CPU milliseconds of clouds of LiDARs that take time for a frame, beside those of a still world.

    python benchmarks/scan_time.py logs/sumo-11

*line_roll*, front ROI, every `--every`-th frame, in turn in one process: mean over frames of the
least of `REPEATS`. `casting` is that of all four LiDARs.
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from lidarplace import PAPER_PLACEMENTS, Lidar
from lidarplace.clouds.collect import SimulatedClouds, crop_for
from lidarplace.clouds.surroundings import Surroundings
from lidarplace.configuration.sensor import SensorSettings
from lidarplace.logs.box_log import read_box_log
from lidarplace.rigs.scan_timing import ScanTiming

REPEATS = 5
LIDARS = {
    f"{steps} azimuth steps": Lidar.even(azimuth_steps=steps, range_noise=0.02, drop_off=0.05)
    for steps in (5625, 1800, 900)
}
LIDARS["mid70, a pattern of 10,000 rays"] = SensorSettings(name="mid70").lidar()
TIMINGS = {"off": None, "on": ScanTiming(10.0)}


def main(log: Path, every: Annotated[int, typer.Option(min=1)] = 60) -> None:
    """Print a line for each LiDAR, of casting and of whole clouds."""
    box_log = read_box_log(log)
    surroundings, numbers = Surroundings(box_log), box_log.frames["frame"].to_numpy()[::every]
    for label, lidar in LIDARS.items():
        clouds = {}
        for name, timing in TIMINGS.items():
            rig = PAPER_PLACEMENTS["line_roll"].with_lidar(replace(lidar, timing=timing))
            crop = crop_for((0, 40), (-20, 20), (0, 4), rig)
            clouds[name] = SimulatedClouds(surroundings, numbers, rig, crop)
        spent = np.full((1 + REPEATS, len(numbers), 2, len(clouds)), np.inf)
        for repeat, index in np.ndindex(spent.shape[:2]):  # another frame has other motion
            for of, simulated in enumerate(clouds.values()):
                scene, start = simulated.scene(index), time.process_time()
                for number in range(len(scene.rig.mounts)):
                    simulated._cast(scene, number, (0, int(numbers[index]), number))
                middle = time.process_time()
                simulated.returns(index)
                spent[repeat, index, :, of] = middle - start, time.process_time() - middle
        # The first repeat compiles.
        for part, times in zip(
            ("casting", "cloud"), spent[1:].min(axis=0).mean(axis=0), strict=True
        ):
            off, on = 1e3 * times
            print(f"{label}, {part}: {off:.2f} -> {on:.2f} ms, {on / off:.2f} times")


if __name__ == "__main__":
    typer.run(main)
