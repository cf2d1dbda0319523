"""Seconds until a sweep's trials are in MLflow.

    python benchmarks/mlflow_log.py sqlite:///FILE --trials 2000

Logs trials of 12 metrics and 8 parameters, as a sweep does, into an experiment of its own. Prints
the seconds until all had been delivered, which a sweep spends on other work, and those of the
processor, which tell more beside other work; and how long it takes to find that nothing is missing.
"""

from __future__ import annotations

import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from tracking.mlflow.content import EndedTrial, ParentRun, TrialRun
from tracking.mlflow.log import SweepLog

METRICS = {f"AP_R40_3D.Car.{i}": i / 7 for i in range(12)}
PARAMS = {f"training.parameter_{i}": i for i in range(8)}


def main(uri: str, trials: Annotated[int, typer.Option(min=1)] = 2000) -> None:
    parent = ParentRun("benchmark", f"benchmark {time.time():.0f}", {})
    ended = [
        EndedTrial(f"t{i}", partial(TrialRun, f"trial {i}", PARAMS, METRICS, ended=1_000_000_000))
        for i in range(trials)
    ]
    for what in ("delivered", "compared"):
        with tempfile.TemporaryDirectory() as folder:
            start = time.perf_counter()
            with SweepLog(uri, parent, folder=Path(folder)) as log:
                opened, busy = time.perf_counter(), time.process_time()
                log.follow(lambda: ended)
            seconds, busy = time.perf_counter() - opened, time.process_time() - busy
        print(f"{'opened':24s}{opened - start:8.2f} s")
        for name, spent in ((what, seconds), ("processor", busy)):
            print(f"{name:24s}{spent:8.2f} s {1000 * spent / trials:8.2f} ms a trial")


if __name__ == "__main__":
    typer.run(main)
