"""How many rigs a search evaluates in a second, and what fewer azimuth steps cost in accuracy.

    OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 python benchmarks/search_speed.py

Random rigs of `examples/search.yaml` (four LiDARs, two classes, front ROI) in two processes at once
with one thread each; the error is that of the paper's eight rigs against all rays.
"""

from __future__ import annotations

import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import optuna

from lidarplace.command_line.terminal import output
from sweeps.execution.backends import InProcess
from sweeps.search.problem.assess import assess
from sweeps.search.problem.problem import SearchProblem, read_problem
from sweeps.search.trials.traffic import training_traffic
from sweeps.store.open import store_of

CONFIG = Path("examples/search.yaml")
RIGS = 100
PROCESSES = 2


def problem_at(resolution: float, objective: str) -> tuple[SearchProblem, dict]:
    """The problem, and its POG from a folder that later runs find again."""
    folder = Path(tempfile.gettempdir()) / "search_speed"
    problem = read_problem(
        CONFIG,
        [
            *(f"surrogate.resolution={resolution}", f"search.objective={objective}"),
            *(f"output={folder}", "ray=debug"),
        ],
    )
    store = store_of(problem.sweep())
    return problem, training_traffic(output(), problem, store, InProcess())


def rate(job: tuple[float, str, int, int]) -> float:
    """Rigs a second of one process."""
    resolution, objective, stride, seed = job
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    problem, traffic = problem_at(resolution, objective)
    criteria = replace(problem.criteria, azimuth_stride=stride)
    study = optuna.create_study(sampler=optuna.samplers.RandomSampler(seed))
    rigs = [problem.space.suggest(study.ask())[0] for _ in range(RIGS + 3)]
    for rig in rigs[:3]:  # load the compiled code
        assess(rig, criteria, traffic)
    start = time.perf_counter()
    for rig in rigs[3:]:
        assess(rig, criteria, traffic)
    return RIGS / (time.perf_counter() - start)


def errors(resolution: float, objective: str, stride: int) -> np.ndarray:
    """Relative errors of the paper's eight."""
    problem, traffic = problem_at(resolution, objective)
    values = []
    for steps in (stride, 1):
        criteria = replace(problem.criteria, azimuth_stride=steps)
        found = [assess(rig, criteria, traffic).values for rig in problem.paper_rigs().values()]
        values.append(np.array([own[objective] for own in found if own]))
    return values[0] / values[1] - 1


def main() -> None:
    print("objective        resolution  stride  rigs/s  mean error  worst error")
    for resolution in (0.2, 0.1):
        for objective, stride in (
            ("covered_entropy", 1),
            ("expected_ig", 4),
            ("expected_ig", 8),
            ("expected_ig", 16),
        ):
            jobs = [(resolution, objective, stride, seed) for seed in range(PROCESSES)]
            with ProcessPoolExecutor(PROCESSES, mp_context=get_context("spawn")) as processes:
                rates = list(processes.map(rate, jobs))
            own = errors(resolution, objective, stride) if stride > 1 else np.zeros(1)
            print(
                f"{objective:16s} {resolution:10g} {stride:7d} {sum(rates):7.0f} "
                f"{own.mean():11.2%} {abs(own).max():12.2%}"
            )


if __name__ == "__main__":
    main()
