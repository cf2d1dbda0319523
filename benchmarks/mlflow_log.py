"""Seconds until a sweep's trials are in MLflow.

    python benchmarks/mlflow_log.py sqlite:///FILE --trials 2000

Logs trials of 12 metrics and 8 parameters, as a sweep does, into an experiment of its own. Prints
the seconds that the driver was held up (the journal), those until all had been delivered, and
those of the processor, which tell more beside other work.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Annotated

import typer

from tracking.mlflow.log import SweepLog

METRICS = {f"AP_R40_3D.Car.{i}": i / 7 for i in range(12)}
PARAMS = {f"training.parameter_{i}": i for i in range(8)}


def main(uri: str, trials: Annotated[int, typer.Option(min=1)] = 2000) -> None:
    with tempfile.TemporaryDirectory() as folder:
        name = f"benchmark {time.time():.0f}"
        start = time.perf_counter()
        with SweepLog(uri, name, "benchmark", {}, journal=Path(folder) / "mlflow.jsonl") as log:
            opened, busy = time.perf_counter(), time.process_time()
            for i in range(trials):
                log.trial(f"t{i}", f"trial {i}", PARAMS, METRICS)
            logged = time.perf_counter()
        end, busy = time.perf_counter(), time.process_time() - busy
    print(f"{'opened':24s}{opened - start:8.2f} s")
    spent = {"held up": logged - opened, "delivered": end - opened, "processor": busy}
    for what, seconds in spent.items():
        print(f"{what:24s}{seconds:8.2f} s {1000 * seconds / trials:8.2f} ms a trial")


if __name__ == "__main__":
    typer.run(main)
