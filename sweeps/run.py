"""The main job: `python -m sweeps.run grid.yaml`."""

from __future__ import annotations

import hashlib
import json
import os
import shlex
import sys
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from lidarplace.command_line import output, wrong
from sweeps.config import SweepFile
from sweeps.grid import ConfigError, Sweep
from sweeps.plan import Plan, Trial, further_axes, read_plan
from sweeps.store import Store

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def run(
    config: Annotated[Path | None, typer.Argument(help="YAML file of the sweep")] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="override a key path")
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="print the plan and stop")] = False,
    schema: Annotated[bool, typer.Option("--schema", help="print the JSON schema")] = False,
) -> None:
    """Run a sweep: scenes, surrogates, point clouds, detectors, MLflow, report.

    The same command continues a sweep that was stopped. Exit code 0: all trials finished; 1: some
    failed; 2: the configuration is wrong; 130: stopped by Ctrl-C.
    """
    console = output()
    if schema:
        print(json.dumps(SweepFile.model_json_schema(), indent=2))
        return
    if config is None:
        wrong("name a configuration file, such as examples/grid.yaml")
    try:
        sweep, plan = read_plan(config, set_ or [])
    except ConfigError as error:
        wrong(error)
    store = Store(sweep.common.output / "store")
    cached = {task.key for task in plan.tasks if store.has(task)}
    if dry_run:
        _print_plan(console, sweep, plan, cached)
        return
    try:
        failed = _run(console, sweep, plan, store, cached)
    except ConfigError as error:
        wrong(error)
    except KeyboardInterrupt:
        console.print("\nStopped. What is finished is kept; the same command goes on from there.")
        raise typer.Exit(130) from None
    if failed:
        raise typer.Exit(1)


def _run(
    console: Console, sweep: Sweep, plan: Plan, store: Store, cached: set[str]
) -> Sequence[Trial]:
    """Run the plan, log it, report it. Returns the trials that failed."""
    from sweeps.execute import backend_for, execute
    from sweeps.progress import StageProgress
    from sweeps.trial_log import TrialLog
    from sweeps.write_run import trial_failure, write_run
    from tracking.mlflow_log import SweepLog, ui_command
    from tracking.report import build_report

    start = time.monotonic()
    folder = sweep.common.output / sweep.common.name
    command = shlex.join(["python", "-m", "sweeps.run", *sys.argv[1:]])
    keys = "".join(sorted(trial.key for trial in plan.trials))
    key = hashlib.sha256(keys.encode()).hexdigest()[:12]
    parameters = {
        "placements": len({trial.grid_point.point.placement for trial in plan.trials}),
        "trials": len(plan.trials),
        "axes": ", ".join(sorted(sweep.axes)),
    }
    with ExitStack() as stack:
        try:
            log = stack.enter_context(
                SweepLog(sweep.common.tracking_uri, sweep.common.name, key, parameters)
            )
        except ValueError as error:  # the tracking server cannot take this sweep
            raise ConfigError(f"tracking: {error}") from None
        with (
            backend_for(sweep.common.ray, store) as backend,
            StageProgress(console, plan.tasks, cached) as progress,
        ):
            listener = TrialLog(progress, log, plan, store, further_axes(sweep), folder / "failed")
            listener.log_finished()
            failures = execute(plan.tasks, store, backend, listener)
        listener.log_failed(failures)
        failed = [trial for trial in plan.trials if trial_failure(trial, failures)]
        write_run(folder, sweep, plan, store, failures, cached, command, time.monotonic() - start)
        if len(failed) < len(plan.trials):
            report = build_report(folder)
            for path in (report, *sorted(folder.glob("*.parquet")), folder / "config.yaml"):
                log.artifact(path)
            _print_summary(console, folder)
            console.print(f"\nReport  {report}", soft_wrap=True)
        console.print(f"MLflow  {ui_command(sweep.common.tracking_uri)}", soft_wrap=True)
    console.print(f"{time.monotonic() - start:.0f} s", highlight=False)
    for trial in failed:
        reason = trial_failure(trial, failures)
        console.print(f"failed: {trial.label}: {reason}", markup=False, soft_wrap=True)
    if failed:
        console.print(f"{len(failed)} of {len(plan.trials)} trials failed; see {folder / 'failed'}")
    return failed


def _print_plan(console: Console, sweep: Sweep, plan: Plan, cached: set[str]) -> None:
    table = Table(title=f"{sweep.common.name}: {len(plan.trials)} trials")
    for column in ("stage", "tasks", "cached", "to do"):
        table.add_column(column, justify="left" if column == "stage" else "right")
    total = Counter(task.stage for task in plan.tasks)
    there = Counter(task.stage for task in plan.tasks if task.key in cached)
    for stage, count in total.items():
        table.add_row(stage, str(count), str(there[stage]), str(count - there[stage]))
    console.print(table)
    scenes = {trial.scene_label: trial.grid_point.point.scene for trial in plan.trials}
    for label, scene in scenes.items():
        train, test = scene.frame_counts()
        console.print(f"scene {label}: {train} frames to train, {test} to test")
    for trial in plan.trials:
        done = all(task.key in cached for task in trial.results)
        console.print(f"trial {trial.key}  {trial.label}{'  (cached)' if done else ''}")


def _print_summary(console: Console, folder: Path) -> None:
    from tracking.run_folder import RunFolder
    from tracking.summary import summary_table

    summary = summary_table(RunFolder.read(folder))
    table = Table(title=f"{folder.name}: best placement first, means over seeds, percent")
    for column in summary.columns:
        table.add_column(str(column), justify="left" if column == "placement" else "right")
    for row in summary.itertuples(index=False):
        table.add_row(*(_short(value) for value in row))
    console.print(table)


def _short(value: object) -> str:
    """A number in six places or less: 62.3, -134k, 7.69k."""
    if not isinstance(value, float):
        return str(value)
    return f"{value / 1000:.3g}k" if abs(value) >= 1000 else f"{value:.1f}"


def main() -> None:
    """Command line."""
    os.environ["MLFLOW_DISABLE_TELEMETRY"] = "true"
    app()


if __name__ == "__main__":
    main()
