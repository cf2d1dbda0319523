"""Verdicts on 20 grids of positions that begin elsewhere, and the CPU time of a check.

A shuttle with three LiDARs, a pedestrian within 0.5 to 5 m:

    PYTHONPATH=. python benchmarks/phases.py"""

import time
from collections import Counter

import numpy as np

from lidarplace import Lidar, Mount, Placement
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.requirements.check_requirements import check_requirements
from lidarplace.requirements.layout import lay_out
from lidarplace.requirements.requirement import STANDARD, Requirement
from tests.lidarplace.requirements.test_phases import Shifted

SHUTTLE = Vehicle("shuttle", np.array([[[-2.5, -1.0, 0.0], [2.5, 1.0, 2.6]]]))
LIDAR = Lidar(tuple(np.radians(np.linspace(-55, 15, 16))), azimuth_steps=900)
MOUNTS = [Mount(x=1.2, y=1.1, z=2.4), Mount(x=-0.8, y=-1.1, z=2.4), Mount(x=2.6, y=0.2, z=1.4)]
RIG = Placement("three", MOUNTS, LIDAR)
STEP = 0.25


def main() -> None:
    """Print a row for each requirement."""
    phases = np.random.default_rng(1).uniform(0, STEP, (20, 2)).tolist()
    for share in (0.9, 0.94, 0.944, 0.946, 0.948, 0.952, 0.98):
        counts, enough, seconds = Counter(), [], 0.0
        for by in phases:
            area = Shifted(distance=(0.5, 5.0))
            object.__setattr__(area, "by", tuple(by))
            person = STANDARD["Pedestrian"]
            layout = lay_out(Requirement("near", area, "points", 20, person, share, STEP), SHUTTLE)
            check_requirements([layout], RIG, SHUTTLE)
            start = time.process_time()
            (result,) = check_requirements([layout], RIG, SHUTTLE)
            seconds += time.process_time() - start
            counts["within" if result.worst.undecided else "pass" if result.met else "FAIL"] += 1
            enough.append(100 * result.worst.enough)
        span = f"{min(enough):.2f} to {max(enough):.2f} %"
        print(f"20 points, for {share}: {dict(counts)}, {span}, {1e3 * seconds / 20:.0f} ms")


if __name__ == "__main__":
    main()
