"""A sweep of 2,000 placements without a detector, from the command line to the report.

python benchmarks/many_placements.py
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pandas as pd
import yaml
from random_placements import random_placements

SWEEP = {
    "scene": {
        "density": 80,
        "routes": 4,
        "test_routes": 1,
        "frames_per_route": 100,
        "frame_stride": 10,
    },
    "detector": None,
    "surrogate": {
        "names": ["s_mig", "covered_entropy", "residual_entropy", "h_pog", "m_sog"],
        "accuracy": False,
        "sampling_error": False,
    },
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--placements", type=int, default=2000)
    parser.add_argument("--cpus", type=int, default=2)
    arguments = parser.parse_args()
    placements = random_placements(arguments.placements)
    with tempfile.TemporaryDirectory() as folder:
        grid = {"placements": placements, "grid": {"placement": list(placements)}}
        ray = {"ray": {"num_cpus": arguments.cpus}, "output": f"{folder}/runs"}
        config = Path(folder) / "many.yaml"
        config.write_text(yaml.safe_dump(SWEEP | grid | ray))
        for what in ("new", "again, with all results there"):
            start = time.perf_counter()
            command = [sys.executable, "-m", "sweeps.run", str(config)]
            subprocess.run(command, check=True, capture_output=True)
            print(f"{len(placements)} placements, {what}: {time.perf_counter() - start:.0f} s")
            if what == "new":
                tasks = pd.read_parquet(f"{folder}/runs/many/tasks.parquet")
                print(tasks.groupby("stage", sort=False)["seconds"].agg(["size", "sum"]).round(3))
                busy = tasks["seconds"].sum() / (tasks["ended"].max() * arguments.cpus)
                print(f"share of the cores' time that tasks took: {busy:.0%}")


if __name__ == "__main__":
    main()
