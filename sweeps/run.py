"""The main job: `python -m sweeps.run grid.yaml`."""

from __future__ import annotations

import hashlib
import json
import os
import shlex
import sys
import time
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from lidarplace.command_line import output, wrong
from sweeps.clean_store import clean_store
from sweeps.config import SweepFile
from sweeps.failures import FailureFolder
from sweeps.grid import Sweep
from sweeps.plan import Plan, further_axes, read_plan
from sweeps.print_plan import print_plan
from sweeps.result_folder import DamagedResult
from sweeps.store import AnyStore
from sweeps.store_lock import locked
from sweeps.sweep_store import reference, store_of
from sweeps.task import Task
from sweeps.trial_results import trial_failure

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)

_GOES_ON = "What is finished is kept; the same command goes on from there."


@app.command()
def run(
    config: Annotated[Path | None, typer.Argument(help="YAML file of the sweep")] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="override a key path")
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="print the plan and stop")] = False,
    rerun_failed: Annotated[
        bool, typer.Option("--rerun-failed", help="try again what failed for good")
    ] = False,
    schema: Annotated[bool, typer.Option("--schema", help="print the JSON schema")] = False,
) -> None:
    """Run a sweep: scenes, surrogates, point clouds, detectors, MLflow, report.

    The same command continues a sweep that was stopped. What failed because of its data or
    settings is not tried again without --rerun-failed; what a machine was to blame for is.

    Exit code 0: all trials finished; 1: some failed, or MLflow has not got all; 2: the
    configuration is wrong; 130: stopped by Ctrl-C.
    """
    console = output()
    if schema:
        print(json.dumps(SweepFile.model_json_schema(), indent=2))
        return
    if config is None:
        wrong("name a configuration file, such as examples/grid.yaml")
    try:
        sweep, plan = read_plan(config, set_ or [])
        store = store_of(sweep)
    except ValueError as error:
        wrong(error)
    if dry_run:
        print_plan(console, sweep, plan, store)
        return
    from sweeps.backends import BackendLost

    try:
        complete = run_sweep(console, sweep, plan, store, rerun_failed)
    except (BackendLost, DamagedResult, OSError) as error:  # such as a disk that is full
        console.print(f"\n{error}. {_GOES_ON}", markup=False, soft_wrap=True)
        raise typer.Exit(1) from None
    except KeyboardInterrupt:
        console.print(f"\nStopped. {_GOES_ON}")
        raise typer.Exit(130) from None
    if not complete:
        raise typer.Exit(1)


def run_sweep(
    console: Console, sweep: Sweep, plan: Plan, store: AnyStore, rerun_failed: bool
) -> bool:
    """Run the plan, log it, report it. Returns whether all trials finished and were logged.

    Raises:
        typer.Exit: another driver runs the sweep, or MLflow or Ray cannot be had.
        BackendLost: Ray has gone.
        OSError: the run folder cannot be written.
    """
    from sweeps.backends import backend_for
    from sweeps.execute import Outcome, execute
    from sweeps.progress import StageProgress
    from sweeps.promotion import at_most, promote
    from sweeps.trial_log import TrialLog
    from sweeps.write_run import Run, write_run
    from tracking.mlflow_log import SweepLog, ui_command
    from tracking.report import build_report

    start = time.monotonic()
    folder = sweep.common.output / sweep.common.name
    say = partial(console.print, markup=False, soft_wrap=True)
    with ExitStack() as stack:
        workers = ExitStack()  # given back before the report is written
        try:
            stack.enter_context(locked(folder, alone=True))
            store.refer(reference(sweep), [task.key for task in plan.tasks])
            keep_to_quota(console, sweep, store)
            stack.enter_context(store.in_use())
            log = SweepLog(
                sweep.common.tracking_uri,
                sweep.common.name,
                sweep_key(sweep, plan),
                _parameters(sweep, plan),
                journal=folder / "mlflow.jsonl",
                say=say,
            )
            stack.enter_context(log)
            stack.enter_context(workers)
            backend = workers.enter_context(backend_for(sweep.common.ray, store))
        except ValueError as error:  # in use, or MLflow or Ray cannot be had
            wrong(error)
        store.end_running(plan.tasks)  # what a killed driver left
        cached = store.finished(plan.tasks)
        failures = FailureFolder(folder / "failed")
        known = failures.known(rerun_failed, cached)
        outcome = Outcome()
        with workers, StageProgress(console, at_most(sweep, plan), cached) as progress:
            listener = TrialLog(progress, log, plan, store, further_axes(sweep), failures)

            def run_tasks(tasks: list[Task]) -> bool:
                execute(tasks, store, backend, listener, outcome, known)
                return True

            promotion = promote(sweep, plan, store, run_tasks)
            cores = backend.cores
        store.refer(reference(sweep), [*(task.key for task in plan.tasks), *outcome.probes])
        listener.log_rest(outcome.failures)
        command = shlex.join(["python", "-m", "sweeps.run", *sys.argv[1:]])
        seconds = time.monotonic() - start
        run = Run(outcome, promotion, cached, cores, command, start, seconds)
        write_run(folder, sweep, plan, store, run)
        failed = [
            (trial, failure)
            for trial in plan.trials
            if trial.key not in promotion.pruned
            and (failure := trial_failure(trial, outcome.failures))
        ]
        if len(failed) < len(plan.trials):
            report = build_report(folder)
            for path in (report, *sorted(folder.glob("*.parquet")), folder / "config.yaml"):
                log.artifact(path)
            _print_summary(console, folder)
            say(f"\nReport  {report}")
        say(f"MLflow  {ui_command(sweep.common.tracking_uri)}")
    console.print(f"{time.monotonic() - start:.0f} s", highlight=False)
    for trial, failure in failed:
        say(f"failed: {trial.label}: {failure.reason}")
    if failed:
        console.print(
            f"{len(failed)} of {len(plan.trials)} trials failed; see {failures.folder}. "
            "--rerun-failed tries all of them again."
        )
    return not failed and not log.undelivered and not log.refused


def keep_to_quota(console: Console, sweep: Sweep, store: AnyStore) -> None:
    """Remove results that no sweep refers to, oldest first, beyond the quota of the store."""
    quota_gb = sweep.common.store.quota_gb
    if quota_gb is None:
        return
    try:
        with store.exclusive():
            cleaned = clean_store(store, int(quota_gb * 1e9))
    except ValueError as error:
        console.print(f"store: not cleaned: {error}", markup=False, soft_wrap=True)
        return
    if cleaned.kept_bytes > quota_gb * 1e9:
        console.print(
            f"store: {cleaned.kept_bytes / 1e9:.3g} GB belong to sweeps, more than quota_gb "
            f"{quota_gb:g}; python -m sweeps.clean --forget NAME gives up a sweep"
        )


def sweep_key(sweep: Sweep, plan: Plan) -> str:
    """Tells a sweep from others of its name: the same while its trials, axes and rungs are."""
    rungs = [rung.model_dump(mode="json") for rung in sweep.common.promote]
    keys = sorted(trial.key for trial in plan.trials)
    content = json.dumps([keys, rungs, sorted(sweep.axes)])
    return hashlib.sha256(content.encode()).hexdigest()[:12]


def _parameters(sweep: Sweep, plan: Plan) -> dict[str, object]:
    """Parameters of the parent run."""
    return {
        "placements": len({trial.grid_point.point.placement for trial in plan.trials}),
        "trials": len(plan.trials),
        "axes": ", ".join(sorted(sweep.axes)),
    }


def _print_summary(console: Console, folder: Path) -> None:
    from tracking.run_folder import RunFolder
    from tracking.summary import summary_table

    run = RunFolder.read(folder)
    summary = summary_table(run)
    what = "surrogates in nats" if run.results.empty else "means over seeds, percent"
    table = Table(title=f"{folder.name}: best placement first, {what}")
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
