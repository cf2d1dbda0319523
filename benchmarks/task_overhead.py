"""What Ray, the store and the driver cost beside the work of a task.

64 placements go through the stages `surrogates` and `collect`: seconds of work against seconds of
all cores, and what is left over by task.

    python benchmarks/task_overhead.py
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from pathlib import Path
from statistics import median

from random_placements import random_placements

from sweeps.configuration.grid import read_sweep
from sweeps.configuration.sweep import RaySettings
from sweeps.execution.backends import backend_for
from sweeps.execution.execute import execute
from sweeps.plan.plan import make_plan
from sweeps.plan.trial import Plan
from sweeps.store.local import Store
from sweeps.store.open import open_store

SWEEP = """
scene: {{seed: 1, density: 80, routes: 4, test_routes: 2, frames_per_route: 100, frame_stride: 10}}
lidar: {{azimuth_steps: 1800, range_noise: 0.02}}
surrogate: {{accuracy: false, sampling_error: false}}
placements: {placements}
grid: {{placement: {names}}}
"""


class Loud:
    """Listens to nothing but failures."""

    def started(self, task): ...
    def finished(self, task): ...
    def failed(self, task, failure):
        raise RuntimeError(f"{task.label}: {failure.reason}")


def plan_of(number: int) -> Plan:
    """A plan of random placements."""
    rigs = random_placements(number)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "grid.yaml"
        path.write_text(SWEEP.format(placements=rigs, names=list(rigs)))
        return make_plan(read_sweep(path))


def efficiency(plan: Plan, stage: str, store: Store, backend) -> None:
    """Run one stage and print how well it fills the cores."""
    own = [task for task in plan.tasks if task.stage.name == stage]
    # A worker takes seconds to start, and to compile and load its kernels: once a sweep.
    execute(plan.needed_for(own[:8]), store, backend, Loud())
    own = own[8:]
    start = time.perf_counter()
    outcome = execute(plan.needed_for(own), store, backend, Loud())
    wall = time.perf_counter() - start
    work = math.fsum(store.record(task).seconds for task in own)
    over = [
        ended - started - store.record(task).seconds
        for task in own
        for started, ended in [outcome.times[task.key]]
    ]
    print(
        f"{stage}: {len(own)} tasks, {work:.1f} s of work in {wall:.1f} s on {backend.cores} "
        f"cores: efficiency {work / (wall * backend.cores):.3f}; beside its work a task took "
        f"{1e3 * (wall * backend.cores - work) / len(own):.1f} ms of a core, waiting included "
        f"{1e3 * median(over):.0f} ms"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--placements", type=int, default=64)
    parser.add_argument("--cpus", type=int, default=2)
    arguments = parser.parse_args()
    plan = plan_of(arguments.placements)
    with tempfile.TemporaryDirectory() as folder:
        store = open_store(folder, Path(folder))
        with backend_for(RaySettings(num_cpus=arguments.cpus)) as backend:
            for stage in ("surrogates", "collect"):
                efficiency(plan, stage, store, backend)


if __name__ == "__main__":
    main()
