"""CPU time of the main computations in another commit and in this checkout, in turns.

    python benchmarks/against.py d0469931            # all parts, some 8 minutes
    python benchmarks/against.py HEAD~1 pog "S-MIG"  # parts whose names contain one of these

Every part runs on one thread in a process of each side, once to compile, then in turns. A ratio
below 1 says that this checkout is faster: the median of the ratios of the turns, and the lowest and
highest. Seconds are of CPU time, so other work on the machine adds little. "differs" marks parts
whose results are not the same to nine digits; a part that the other commit cannot run has no ratio.
"""

from __future__ import annotations

import json
import math
import os
import resource
import subprocess
import sys
import tarfile
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
import typer
import yaml

ROOT = Path(__file__).parents[1]
LOG = ROOT / "sweeps/benchmark/log"
CROP = (0.0, -20.0, 0.0, 40.0, 20.0, 4.0)
FRAMES = 40
"""Frames of clouds that are simulated, trained on and predicted."""
PLACEMENTS = 1000
Call = Callable[[int], float]
"""One turn, by its number, so that no cache has the result; returns a number of the result."""


def boxes(number: int, per_frame: int = 10) -> pd.DataFrame:
    """Return car-sized boxes of any yaw in the paper's front ROI."""
    random = np.random.default_rng(0)
    x, y = random.uniform(0, 40, number), random.uniform(-20, 20, number)
    yaw = random.uniform(-math.pi, math.pi, number)
    frame, size = np.arange(number) // per_frame, {"length": 4.5, "width": 1.8, "height": 1.5}
    columns = {"frame": frame, "class": "Car", "x": x, "y": y, "z": 0.8, **size, "yaw": yaw}
    return pd.DataFrame(columns)


@cache
def pog_grid() -> Any:
    from lidarplace import OccupancyGrid, Roi

    roi = Roi(x=(0, 40), y=(-20, 20), z=(0, 4), resolution=0.1)
    return OccupancyGrid.from_boxes(boxes(7200, 6), roi, "Car", 1200)


def s_mig(method: str, tilt: float | None) -> Call:
    """Evaluate four LiDARs: level for a tilt of None, else rolled by `tilt` and pitched."""
    from lidarplace import PAPER_PLACEMENTS, Lidar, Placement, evaluate

    def call(turn: int) -> float:
        change = {} if tilt is None else {"roll": tilt, "pitch": 0.1}
        mounts = PAPER_PLACEMENTS["line"].mounts
        moved = [replace(mount, z=mount.z + 1e-6 * turn, **change) for mount in mounts]
        placement = Placement("moved", moved, lidar=Lidar.paper())
        return float(evaluate(pog_grid(), placement, method=method).s_mig)

    return call


def pog(per_frame: int) -> Call:
    """Count the boxes of one class."""
    from lidarplace import OccupancyGrid, Roi

    roi = Roi(x=(0, 40), y=(-20, 20), z=(0, 4), resolution=0.1)
    log = boxes(100_000, per_frame)

    def call(turn: int) -> float:
        grids = OccupancyGrid.by_class(log, roi, ["Car"], 100_000)
        return float(grids["Car"].counts.sum())

    return call


@cache
def log_and_rig() -> tuple[Any, Any, Any]:
    from lidarplace import PAPER_PLACEMENTS, Lidar
    from lidarplace.logs.box_log import read_box_log

    log = read_box_log(LOG)
    lidar = replace(Lidar.paper(), azimuth_steps=900, range_noise=0.02, drop_off=0.05)
    numbers = log.frames.loc[log.frames["split"] == "test", "frame"].to_numpy(np.int64)
    return log, numbers[:FRAMES], PAPER_PLACEMENTS["line"].with_lidar(lidar)


@cache
def clouds() -> Any:
    from lidarplace.clouds.collect import collect

    log, numbers, rig = log_and_rig()
    return collect(log, numbers, rig, CROP)


def rays() -> Call:
    """Simulate the clouds of the frames."""
    from lidarplace.clouds.collect import SimulatedClouds

    log, numbers, rig = log_and_rig()

    def call(turn: int) -> float:
        simulated = SimulatedClouds(log, numbers, rig, CROP)
        return float(sum(len(simulated[i]) for i in range(len(simulated))))

    return call


def expected_recall() -> Call:
    """Compute the expected recall of a rig that is not cached."""
    from lidarplace import ExpectedRecall, Roi

    log, _, rig = log_and_rig()
    roi = Roi(x=(0, 40), y=(-20, 20), z=(0, 4), resolution=0.1)
    model = ExpectedRecall.from_log(log, roi, ["Car"])

    def call(turn: int) -> float:
        mounts = [replace(mount, z=mount.z + 1e-6 * turn) for mount in rig.mounts]
        return float(model.of(replace(rig, mounts=mounts)).iloc[:, 0].sum())

    return call


def prediction() -> Call:
    """Predict all frames with the package's detector."""
    import torch

    from training.detect import detect
    from training.pretrained import read_generalist
    from training.settings import TrainingSettings

    torch.set_num_threads(1)
    weights, frames = read_generalist(ROOT / "training/pretrained.pt"), clouds()
    network = (weights.detector, weights.classes, weights.state_dict)

    def call(turn: int) -> float:
        found = detect(*network, frames, TrainingSettings(), CROP, weights.typical)
        return float(found.boxes["score"].sum())

    return call


def rig() -> Call:
    """Evaluate a rig with the package's detector: clouds, boxes, AP and recall."""
    import torch

    from lidarplace import Roi
    from training import pretrained

    torch.set_num_threads(1)
    log, _, placement = log_and_rig()
    roi = Roi(x=(0, 40), y=(-20, 20), z=(0, 4), resolution=0.1)
    return lambda turn: float(pretrained.evaluate_rigs([placement], log, roi)[0]["value"].sum())


def training(detector: str) -> Call:
    """Train two epochs from scratch."""
    import torch

    from lidarplace.clouds.visibility import ground_truth
    from training import finetune
    from training.settings import TrainingSettings

    torch.set_num_threads(1)
    context = getattr(
        finetune, "TrainingContext", None
    )  # older commits have its fields as arguments
    options = {"context": context(CROP)} if context else {"point_range": CROP}
    objects = ground_truth(log_and_rig()[0], (0, 40), (-20, 20), (0, 4))
    settings = TrainingSettings(epochs=2, batch_size=4, rotation=0.1)

    def call(turn: int) -> float:
        result = finetune.finetune(detector, ["Car"], clouds(), objects, settings, 1, **options)
        return float(sum(float(value.double().sum()) for value in result.state_dict.values()))

    return call


def sweep(folder: Path, placements: int, **settings: Any) -> list[str]:
    """Write a sweep of random rigs, and return the command that runs it."""
    random = np.random.default_rng(0)
    poses = random.uniform((-1, -0.8, 1.6), (1, 0.8, 2.6), (placements, 4, 3)).round(3)
    rigs = {
        f"rig_{n}": {"mounts": [dict(zip("xyz", pose, strict=True)) for pose in mounts]}
        for n, mounts in enumerate(poses.tolist())
    }
    lidar = {"beams": 16, "elevation_deg": [-25, 5], "azimuth_steps": 900}
    configuration = {
        "scene": {"source": "log", "folder": str(LOG)},
        "roi": {"x": [0, 40], "y": [-20, 20], "z": [0, 4]},
        "lidar": lidar,
        "output": str(folder / "runs"),
        "placements": rigs,
        "grid": {"placement": list(rigs)},
        **settings,
    }
    path = folder / "against.yaml"
    path.write_text(yaml.safe_dump(configuration))
    return [sys.executable, "-m", "sweeps.run", str(path)]


def run(command: list[str]) -> None:
    """Run a command whose failure ends the part."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command[2:])}: {done.stderr.strip() or done.stdout[-300:]}")


def planning() -> Call:
    """Plan placements: a dry run, with its imports."""
    folder = Path(tempfile.mkdtemp())
    command = [*sweep(folder, PLACEMENTS, detector="pointpillars_tiny"), "--dry-run"]

    def call(turn: int) -> float:
        run(command)
        return PLACEMENTS

    return call


def end_of_sweep() -> Call:
    """Write the run folder and the pages of a sweep whose results are all stored."""
    folder = Path(tempfile.mkdtemp())
    settings = {"detector": "pointpillars_tiny", "ray": "debug", "judge": "pretrained"}
    # The key of older commits, too.
    settings["classes"] = ["Car", "Pedestrian"]
    surrogate = {"accuracy": False, "resolution": 0.4}
    command = sweep(folder, 12, surrogate=surrogate, **settings)
    run(command)

    def call(turn: int) -> float:
        run(command)
        return float(len(pd.read_parquet(folder / "runs/against/results.parquet")))

    return call


PARTS: dict[str, tuple[Callable[[], Call], int]] = {
    "S-MIG, level": (lambda: s_mig("cone", None), 20),
    "S-MIG, tilted": (lambda: s_mig("cone", 0.15), 20),
    "S-MIG, on their sides": (lambda: s_mig("cone", math.pi / 2), 20),
    "S-MIG, dda": (lambda: s_mig("dda", 0.15), 5),
    "pog, 10 boxes a frame": (lambda: pog(10), 7),
    "pog, 100 boxes a frame": (lambda: pog(100), 7),
    "rays": (rays, 7),
    "expected recall": (expected_recall, 7),
    "prediction, pointpillars_tiny": (prediction, 9),
    "a rig by the package's detector": (rig, 3),
    "training, pointpillars_tiny": (lambda: training("pointpillars_tiny"), 5),
    "training, second_tiny": (lambda: training("second_tiny"), 3),
    f"planning of {PLACEMENTS:,} placements": (planning, 3),
    "end of a sweep of 12 rigs": (end_of_sweep, 3),
}
"""How each part is prepared, and its number of turns."""


def serve() -> None:
    """Answer each part's name with CPU seconds and result of one more turn, as lines of JSON."""
    answers, sys.stdout = sys.stdout, sys.stderr
    folder = tempfile.TemporaryDirectory()  # of all parts, and gone at the end
    tempfile.tempdir = folder.name
    calls: dict[str, Call] = {}
    turns = dict.fromkeys(PARTS, 0)
    for line in sys.stdin:
        name = line.strip()
        try:
            if name not in calls:
                calls = {name: PARTS[name][0]()}
            turns[name] += 1
            start = cpu_seconds()
            value = calls[name](turns[name])
            answer: dict[str, Any] = {"seconds": cpu_seconds() - start, "value": value}
        except Exception as error:  # another commit may refuse a part in any way
            answer = {"missing": f"{type(error).__name__}: {error}"[:200]}
        print(json.dumps(answer), file=answers, flush=True)


def cpu_seconds() -> float:
    """Return the CPU time of this process and of the commands that it ran."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def checkout(commit: str) -> Path:
    """Unpack a commit below build/, once: its compiled kernels are kept."""
    git = ["git", "-C", str(ROOT)]
    name = subprocess.check_output([*git, "rev-parse", f"{commit}^{{commit}}"], text=True).strip()
    folder = ROOT / "build/against" / name
    if not folder.exists():
        partial = Path(tempfile.mkdtemp(dir=ROOT / "build"))
        archive = subprocess.Popen([*git, "archive", name], stdout=subprocess.PIPE)
        with tarfile.open(fileobj=archive.stdout, mode="r|") as files:
            files.extractall(partial, filter="data")
        folder.parent.mkdir(exist_ok=True)
        partial.rename(folder)
    return folder


def child(folder: Path) -> subprocess.Popen[str]:
    """Start the process that runs parts with the code of `folder`."""
    threads = dict.fromkeys(("OMP_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
    environment = os.environ | threads | {"PYTHONPATH": str(folder)}
    command = [sys.executable, __file__, "--serve", "."]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    return subprocess.Popen(command, cwd=folder, env=environment, text=True, **pipes)  # type: ignore[call-overload, no-any-return]


def ask(process: subprocess.Popen[str], part: str) -> dict[str, Any]:
    """Run one turn of a part in a process of `child`."""
    assert process.stdin is not None
    assert process.stdout is not None
    print(part, file=process.stdin, flush=True)
    answer: dict[str, Any] = json.loads(process.stdout.readline())
    return answer


def row(part: str, turns: int, sides: list[subprocess.Popen[str]]) -> str:
    """Return the line of the table for a part."""
    for side in sides:
        first = ask(side, part)
        if "missing" in first:
            which = "this checkout" if side is sides[1] else "the other commit"
            return f"| {part} | | | | not in {which}: {first['missing']} |"
    answers = [[ask(side, part) for side in sides] for _ in range(turns)]
    before, after = (min(pair[side]["seconds"] for pair in answers) for side in (0, 1))
    ratios = sorted(pair[1]["seconds"] / pair[0]["seconds"] for pair in answers)
    same = all(math.isclose(*(one["value"] for one in pair), rel_tol=1e-9) for pair in answers)
    spread = f"{np.median(ratios):.2f} ({ratios[0]:.2f} to {ratios[-1]:.2f})"
    times = f"{1e3 * before:,.1f} | {1e3 * after:,.1f}"
    return f"| {part} | {times} | {spread} | {'' if same else 'differs'} |"


def main(
    commit: Annotated[str, typer.Argument(help="what to compare with")],
    parts: Annotated[list[str] | None, typer.Argument(help="only parts that contain these")] = None,
    serving: Annotated[bool, typer.Option("--serve", hidden=True)] = False,
) -> None:
    if serving:
        serve()
        return
    chosen = [name for name in PARTS if any(part in name for part in parts or [""])]
    (ROOT / "build").mkdir(exist_ok=True)
    sides = [child(checkout(commit)), child(ROOT)]
    print(f"| CPU ms, one thread | {commit} | now | now / {commit} | result |")
    print("|---|---:|---:|---|---|")
    for part in chosen:
        print(row(part, PARTS[part][1], sides), flush=True)
    for side in sides:
        side.communicate()


if __name__ == "__main__":
    typer.run(main)
