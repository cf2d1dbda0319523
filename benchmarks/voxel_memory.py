"""Peak memory of stages on voxels, in bytes a voxel, where every voxel is occupied.

OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 python benchmarks/voxel_memory.py
"""

from __future__ import annotations

import math
import warnings
from argparse import ArgumentParser
from pathlib import Path
from tempfile import TemporaryDirectory

import pandas as pd
import yaml

from lidarplace.logs.box_log import BoxLog, write_box_log
from lidarplace.logs.boxes import CLASSES, GEOMETRY
from sweeps.execution.worker import run_task
from sweeps.plan.plan import read_plan
from sweeps.store.local import Store


def measure(folder: Path, resolution: float, classes: int, occlusion: bool, studies: bool) -> None:
    """Run the stages once and print a line for each."""
    rows = [
        ("a", frame, frame / 10, k, name, 20.0, 0.0, 2.0, 100.0, 100.0, 9.0, 0.1 * frame)
        for frame in range(4)
        for k, name in enumerate(CLASSES)
    ]
    names = ["scene", "frame", "timestamp_s", "object_id", "class", *GEOMETRY]
    frames = pd.DataFrame({"scene": "a", "frame": range(4), "route": 0, "split": "train"})
    frames.insert(2, "timestamp_s", frames["frame"] / 10)
    write_box_log(folder / "log", BoxLog(pd.DataFrame(rows, columns=names), frames))
    surrogate = {
        "resolution": resolution,
        "names": ["s_mig", "expected_points", "expected_ig"],
        "occlusion": occlusion,
        "accuracy": studies,
        "sampling_error": studies,
    }
    config = {
        "scene": {"source": "log", "folder": str(folder / "log")},
        "classes": list(CLASSES[:classes]),
        "detector": None,
        "placement": "line",
        "surrogate": surrogate,
    }
    path = folder / "voxels.yaml"
    path.write_text(yaml.safe_dump(config), encoding="utf-8")
    _, plan = read_plan(path)
    store, voxels = Store(folder / "store"), math.prod(plan.trials[0].pog.stage.roi.shape)
    before = 0.0
    for task in plan.tasks:
        run_task(task, store)
        peak = store.record(task)["peak_memory"]
        if task.stage.name == "scene":
            before = peak
        else:
            print(
                f"{task.stage.name:15} {voxels:.3g} voxels, {classes} classes, "
                f"occlusion {occlusion}: "
                f"{(peak - before) / voxels:4.1f} bytes a voxel, "
                f"{task.stage.need().memory / voxels:.0f} estimated",
                flush=True,
            )


def main() -> None:
    """Three sizes of the paper's ROI, and what makes a difference at the middle one."""
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--resolutions", type=float, nargs="+", default=[0.1, 0.0625, 0.05])
    resolutions = parser.parse_args().resolutions
    warnings.simplefilter("ignore")  # boxes that fill the ROI
    for resolution in resolutions:
        for classes in (1, 3):
            for occlusion in (False, True):
                with TemporaryDirectory() as folder:
                    studies = not occlusion and resolution == resolutions[1]
                    measure(Path(folder), resolution, classes, occlusion, studies)


if __name__ == "__main__":
    main()
