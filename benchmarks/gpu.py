"""All that a GPU is for, in one command, without Ray and without a network.

    python benchmarks/gpu.py [--out build/gpu] [--only SECTION …] [--minutes 5]
    OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 python benchmarks/gpu.py --device cpu --preset tiny

Prints Markdown tables, and writes them and all numbers, as JSON, into a folder. Sections:

- tests: kernels and networks on the GPU against the CPU (pytest)
- networks: ms a frame of prediction and training (median of ten steps after three), peak memory
  (on a CPU that of the process, libraries included), launches, share of the time that the GPU is
  busy, waits; the ten dearest kernels of a step. Ray-cast frames with 30 objects under *line*
- operations: ms of each operation by the CPU's kernel and by the GPU's
- rigs: seconds to cast, predict and evaluate 280 frames of a rig, and of eight
- trainings: frames a second together of many trainings of a tiny network, one after another, in
  threads, in processes; and what grouping them by `vmap` would bring at best
- openpcdet: its networks, as the section networks, where its package `pcdet` can be imported

No measurement begins after `--minutes`. Each network runs in a process of its own. A section that
fails does not stop the others.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import re
import subprocess
import sys
import time
import traceback
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from enum import StrEnum
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import gpu_many
import gpu_networks
import gpu_operations
import torch
import typer

from training import NETWORKS, PRESETS
from training.device import gpu_problem
from training.nvidia import driver_version

ROOT = Path(__file__).parents[1]
SIZES = {"pointpillars": [2, 8], "second": [2, 8], "pv_rcnn": [2, 8]}  # frames a step
ON_GPU = [f"{network}:{','.join(map(str, SIZES.get(network, [2])))}" for network in NETWORKS]
OPERATIONS_S, NETWORKS_S, TESTS_S = 0.3, 1.0, 90.0  # most seconds of a measurement
GRACE_S = 20.0  # for a measurement that runs when the time is over
SECTIONS = ("tests", "networks", "operations", "rigs", "trainings", "openpcdet")
Section = StrEnum("Section", [(name, name) for name in SECTIONS])  # type: ignore[misc]
Preset = StrEnum("Preset", [(name, name) for name in PRESETS])  # type: ignore[misc]
Device = StrEnum("Device", [(name, name) for name in ("cuda", "cpu")])  # type: ignore[misc]
HIDDEN = ("profile", "values", "dearest")  # columns of their own tables


@dataclass
class Report:
    """Tables and numbers of the sections, written after each."""

    folder: Path
    text: list[str] = field(default_factory=list)
    numbers: dict[str, Any] = field(default_factory=dict)

    def say(self, text: str) -> None:
        """Print a part of the report."""
        print(text, flush=True)
        self.text.append(text)

    def table(self, rows: list[dict[str, Any]]) -> None:
        """Print rows as a table, with the columns of all of them."""
        if not rows:
            return
        names = [name for name in dict.fromkeys(name for row in rows for name in row)
                 if not name.endswith(HIDDEN)]  # fmt: skip
        lines = [names, ["---"] + ["---:"] * (len(names) - 1)]
        lines += [[shown(row.get(name)) for name in names] for row in rows]
        self.say("\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n")

    def save(self) -> None:
        """Write the report so far."""
        (self.folder / "gpu.md").write_text("\n".join(self.text) + "\n", encoding="utf-8")
        text = json.dumps(self.numbers, indent=1, default=str)
        (self.folder / "gpu.json").write_text(text, encoding="utf-8")


@dataclass(frozen=True)
class Run:
    """What to measure, and until when."""

    device: str
    preset: str
    networks: list[str]
    deadline: float
    report: Report

    @property
    def small(self) -> bool:
        return self.device == "cpu"

    def left(self) -> float:
        """Return the seconds that are left."""
        return self.deadline - time.monotonic()


def shown(value: object) -> str:
    """Format a cell."""
    if isinstance(value, float):
        return f"{value:,.3g}" if value < 1000 else f"{value:,.0f}"
    return "–" if value is None else f"{value:,}" if isinstance(value, int) else str(value)


def main(
    out: Annotated[Path, typer.Option(help="folder of the report")] = Path("build/gpu"),
    only: Annotated[list[Section] | None, typer.Option(help="sections; all by default")] = None,
    network: Annotated[
        list[str] | None, typer.Option(help="such as second:2,8, with its frames a step")
    ] = None,
    minutes: Annotated[float, typer.Option(help="no measurement begins after these")] = 5,
    device: Device = Device("cuda"),
    preset: Preset = Preset("openpcdet"),
) -> None:
    os.environ.setdefault("NUMBA_NUM_THREADS", "1")
    if device == "cuda" and (problem := gpu_problem() or not torch.cuda.is_available()):
        raise SystemExit(f"--device cuda: {problem if problem is not True else 'no GPU'}")
    out.mkdir(parents=True, exist_ok=True)
    report = Report(out)
    report.numbers["machine"] = machine()
    report.say("\n".join(f"- {name}: {text}" for name, text in machine().items()) + "\n")
    chosen = network or (ON_GPU if device == "cuda" else list(NETWORKS))
    run = Run(str(device), str(preset), chosen, time.monotonic() + 60 * minutes, report)
    failed = []
    for section in only or SECTIONS:
        report.say(f"## {section}\n")
        try:
            MEASUREMENTS[str(section)](run)
        except Exception as error:
            traceback.print_exc()
            report.say(f"{type(error).__name__}: {' '.join(str(error).split())[:500]}\n")
            failed.append(str(section))
        report.save()
    if failed:
        raise SystemExit(f"failed: {', '.join(failed)}; the rest is in {out}")


def machine() -> dict[str, str]:
    """Describe the device and the versions that matter."""
    found = {"CPU": f"{os.cpu_count()} cores", "CUDA": str(torch.version.cuda)}
    if torch.cuda.is_available():
        found["GPU"], found["driver"] = torch.cuda.get_device_name(), driver_version()
    for package in ("torch", "triton", "numba", "numpy", "spconv"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not there"
    return found


def run_tests(run: Run) -> None:
    """Run the tests of the GPU, and of each operation with a kernel; print pytest's last lines."""
    tests = sorted((ROOT / "tests/training").glob("test_*.py"))
    pattern = re.compile(r"_triton|ops\.gpu|ops import gpu")
    kernels = [str(path) for path in tests if pattern.search(path.read_text(encoding="utf-8"))]
    commands = {"networks": ["tests/training/test_gpu.py", "-k", "cuda"], "kernels": kernels}
    if run.small:  # there are no other tests of networks without a GPU
        commands = {"kernels": ["tests/training/test_gpu_kernels.py"]}
    failed = []
    for name, arguments in commands.items():
        command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *arguments]
        limit = max(10.0, min(TESTS_S, run.left()))
        try:
            done = subprocess.run(
                command, cwd=ROOT, capture_output=True, text=True, timeout=limit, check=False
            )
            last, code = done.stdout.strip().splitlines()[-1:], done.returncode
            (run.report.folder / f"tests_{name}.txt").write_text(done.stdout, encoding="utf-8")
        except subprocess.TimeoutExpired:
            last, code = [f"not ended after {limit:.0f} s"], 1
        run.report.say(f"{name}: {' '.join(last)}\n")
        run.report.numbers[f"tests of {name}"] = last
        failed += [name] if code else []
    if failed:
        raise RuntimeError(f"tests of {', '.join(failed)} failed")


def measure_networks(run: Run) -> None:
    report_networks(run, "networks", gpu_networks.measure, run.preset, run.device)


def measure_openpcdet(run: Run) -> None:
    if run.small or not find_spec("pcdet"):
        run.report.say("No package pcdet, or no GPU.\n")
    else:
        report_networks(run, "openpcdet", gpu_networks.measure_openpcdet)


def report_networks(run: Run, side: str, measure: Callable[..., list[dict]], *how: str) -> None:
    """Measure networks, each in a process, and print tables of all that could be measured."""
    problems, rows = [], []
    for text in run.networks:
        name, _, sizes = text.partition(":")
        frames = [int(size) for size in sizes.split(",")] if sizes else [2]
        try:
            rows += in_process(run, measure, name, *how, frames, NETWORKS_S)
        except Exception as error:
            problems.append(f"{text}: {type(error).__name__}: {' '.join(str(error).split())[:300]}")
    run.report.numbers[side] = rows
    run.report.table(rows)
    profiles = [
        ({"network": row["network"], "frames": row["frames"], "step": step}, row[profile])
        for row in rows
        for step in ("predict", "train")
        if (profile := f"{step}: profile") in row
    ]
    if not run.small:
        run.report.table([step | profile for step, profile in profiles])
    for step, profile in profiles:
        if step["frames"] <= 2:
            run.report.say(f"### {step['network']}, {step['step']}\n")
            columns = ("place", "ms", "calls")
            run.report.table([dict(zip(columns, row, strict=True)) for row in profile["dearest"]])
    if problems:
        raise RuntimeError("; ".join(problems))


def in_process(run: Run, measure: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function in a new process: a fork has no CUDA, and an error of CUDA stays there.

    Raises TimeoutError: not begun, or not ended in the time that is left and a grace."""
    if run.left() <= 0:
        raise TimeoutError("not run: the time is over")
    pool = ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"))
    try:
        return pool.submit(measure, *arguments).result(run.left() + GRACE_S)
    finally:
        pool.shutdown(wait=False)
        for process in multiprocessing.active_children():
            process.kill()


def measure_operations(run: Run) -> None:
    rows = in_process(run, gpu_operations.measure, run.device, run.preset, OPERATIONS_S)
    run.report.numbers["operations"] = rows
    run.report.say("Milliseconds:\n")
    run.report.table(rows)


def measure_rigs(run: Run) -> None:
    rows = in_process(run, gpu_many.measure_rigs, run.device, 20 if run.preset == "tiny" else 280)
    run.report.numbers["rigs"] = rows
    run.report.table(rows)


def measure_trainings(run: Run) -> None:
    counts, window_s = ([1, 2], 0.5) if run.small else ([1, 4, 8, 24], 1.0)
    run.report.say("Frames a second together, four a step:\n")
    rows: list[dict] = []
    run.report.numbers["trainings"] = rows
    try:
        for count in counts:
            rows.append(in_process(run, gpu_many.measure_trainings, count, run.device, window_s))
    finally:
        run.report.table(rows)


MEASUREMENTS = {
    "tests": run_tests,
    "networks": measure_networks,
    "operations": measure_operations,
    "rigs": measure_rigs,
    "trainings": measure_trainings,
    "openpcdet": measure_openpcdet,
}

if __name__ == "__main__":
    typer.run(main)
