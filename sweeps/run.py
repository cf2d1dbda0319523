"""The main job: `python -m sweeps.run grid.yaml`."""

from __future__ import annotations

import hashlib
import json
import os
import time
from contextlib import ExitStack
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from lidarplace.command_line.invocation import called, command
from lidarplace.command_line.terminal import output
from lidarplace.command_line.verbs import JsonOption, new_app, print_json, verb, wrong
from sweeps.configuration.grid import Sweep
from sweeps.configuration.sweep import SweepFile
from sweeps.execution.failures import FailureFolder
from sweeps.execution.interrupted import going_on
from sweeps.options import ConfigUnlessSchema, DryRunOption, SchemaOption, SetOption
from sweeps.plan.plan import Plan, further_axes, read_plan
from sweeps.results.dry_run import planned, print_planned
from sweeps.results.trial_results import trial_failure
from sweeps.store.cleaning import clean_store
from sweeps.store.damage import until_whole
from sweeps.store.leftovers import remove_leftovers_of
from sweeps.store.lock import locked
from sweeps.store.of_sweep import check_writable, reference, store_of
from sweeps.store.open import AnyStore
from sweeps.tasks.task import Task

app = new_app()


@verb(
    app,
    "examples/grid.yaml",
    "examples/grid.yaml --set training.epochs=2 --dry-run",
    failed="trials failed, the machine failed the sweep, or MLflow has not got all",
)
def run(
    config: ConfigUnlessSchema = None,
    set_: SetOption = None,
    dry_run: DryRunOption = False,
    rerun_failed: Annotated[
        bool, typer.Option("--rerun-failed", help="try again what failed for good")
    ] = False,
    schema: SchemaOption = False,
    as_json: JsonOption = False,
) -> None:
    """Run a sweep: scenes, surrogates, point clouds, detectors, MLflow, report.

    The same command continues a sweep that was stopped. What failed because of its data or
    settings is not tried again without --rerun-failed; what a machine was to blame for is.
    """
    if schema:
        print_json(SweepFile.model_json_schema())
        return
    if config is None:
        wrong("name a configuration file, such as examples/grid.yaml")
    if as_json and not dry_run:
        told = command("sweeps.status", "--json")
        wrong(f"--json: is for --dry-run and --schema; {told} tells how a sweep goes")
    try:
        sweep, plan = read_plan(config, set_ or [])
        store = store_of(sweep)
    except (ValueError, OSError) as error:
        wrong(error)
    console = output()
    if dry_run:
        shown = planned(sweep, plan, store)
        if as_json:
            print_json(asdict(shown))
        else:
            print_planned(console, shown)
        return
    os.environ["MLFLOW_DISABLE_TELEMETRY"] = "true"  # before anything imports it
    try:
        check_writable(sweep, store)
    except OSError as error:
        wrong(error)
    with going_on(console):
        complete = until_whole(
            lambda: run_sweep(console, sweep, plan, store, called(), rerun_failed),
            partial(console.print, soft_wrap=True),
        )
    if not complete:
        raise typer.Exit(1)


def run_sweep(
    console: Console,
    sweep: Sweep,
    plan: Plan,
    store: AnyStore,
    command: str,
    rerun_failed: bool,
) -> bool:
    """Run the plan, log it, report it. Returns whether all trials finished and were logged.

    Args:
        command: what makes the sweep again.
        rerun_failed: try again what failed for good.

    Raises:
        typer.Exit: another driver runs the sweep, or MLflow or Ray cannot be had.
        BackendLost: Ray has gone.
        DamagedResult: a result was damaged; it is not there any more when this is called again.
        OSError: the run folder cannot be written.
    """
    from sweeps.execution.backends import backend_for
    from sweeps.execution.execute import Outcome, execute
    from sweeps.execution.progress import StageProgress
    from sweeps.mlflow.best_models import log_best_models
    from sweeps.mlflow.page import ABOUT, columns, note
    from sweeps.mlflow.trials import TrialLog
    from sweeps.results.promotion import at_most, promote
    from sweeps.results.run_folder import Run, write_run
    from tracking.mlflow.content import ParentRun
    from tracking.mlflow.log import SweepLog
    from tracking.mlflow.source import source_tags
    from tracking.mlflow.system import SystemMonitor
    from tracking.mlflow.uri import ui_command
    from tracking.report.build import build_report

    start = time.monotonic()
    folder = sweep.common.output / sweep.common.name
    say = partial(console.print, soft_wrap=True)
    with ExitStack() as stack:
        workers = ExitStack()  # given back before the report is written
        try:
            stack.enter_context(locked(folder, alone=True))
            remove_leftovers_of(sweep.common, store)
            store.refer(reference(sweep), [task.key for task in plan.tasks])
            keep_to_quota(console, sweep, store)
            stack.enter_context(store.in_use())
            parent = ParentRun(
                sweep_key(sweep, plan),
                sweep.common.name,
                _parameters(sweep, plan),
                tags=source_tags(),
                note=note(sweep.source, command, sweep.common.urls),
                about=ABOUT,
                columns=columns(sweep),
            )
            log = SweepLog(sweep.common.tracking_uri, parent, folder=folder, say=say)
            stack.enter_context(log)
            stack.enter_context(workers)
            backend = workers.enter_context(backend_for(sweep.common.ray))
            workers.enter_context(SystemMonitor(log.sample, say))
        except ValueError as error:  # in use, or MLflow or Ray cannot be had
            wrong(error)
        store.end_running(plan.tasks)  # what a killed driver left
        cached = store.finished(plan.tasks)
        failures = FailureFolder(folder / "failed")
        try:
            known = failures.known(rerun_failed, cached)
        except ValueError as error:
            wrong(error)
        outcome = Outcome()
        with workers, StageProgress(console, at_most(sweep, plan), cached) as progress:
            listener = TrialLog(
                progress,
                plan.trials,
                store,
                axes=further_axes(sweep),
                there=cached,
                failures=failures,
                pictures=folder / "pictures",
            )
            log.follow(listener.ended)

            def run_tasks(tasks: list[Task]) -> bool:
                execute(tasks, store, backend, listener, outcome, known)
                return True

            promotion = promote(sweep, plan, store, run_tasks)
            cores = backend.cores
        store.refer(reference(sweep), [*(task.key for task in plan.tasks), *outcome.probes])
        listener.end(outcome.failures)
        log.hold()
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
            written = (report, report.with_suffix(".md"), folder / "sweep.json")
            for path in (*written, *sorted(folder.glob("*.parquet")), folder / "config.yaml"):
                log.artifact(path)
            for path in sorted((folder / "tables").glob("*.csv")):
                log.artifact(path, "tables")
            log_best_models(plan.trials, store, folder / "models", log)
            _print_summary(console, folder)
            say(f"\nReport  {report}")
        say(f"MLflow  {ui_command(sweep.common.tracking_uri, log.page())}")
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
        console.print(f"store: not cleaned: {error}", soft_wrap=True)
        return
    if cleaned.kept_bytes > quota_gb * 1e9:
        console.print(
            f"store: {cleaned.kept_bytes / 1e9:.3g} GB belong to sweeps, more than quota_gb "
            f"{quota_gb:g}; {command('sweeps.clean')} lists their names, and --forget NAME gives "
            "one up"
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
    from tracking.findings.ray_counting import largest_linear_share, ray_counting_caution
    from tracking.findings.summary import summary_table
    from tracking.run_folders.sweep import RunFolder

    run = RunFolder.read(folder)
    summary = summary_table(run)
    what = "surrogates in nats" if run.results.empty else "means over seeds, percent"
    table = Table(title=f"{folder.name}: best placement first, {what}")
    for column in summary.columns:
        table.add_column(str(column), justify="left" if column == "placement" else "right")
    for row in summary.itertuples(index=False):
        table.add_row(*(_short(value) for value in row))
    console.print(table)
    said = ray_counting_caution(largest_linear_share(run.surrogates))
    if said:
        console.print(f"warning: {said}", style="yellow", soft_wrap=True)


def _short(value: object) -> str:
    """A number in six places or less: 62.3, -134k, 7.69k."""
    if not isinstance(value, float):
        return str(value)
    return f"{value / 1000:.3g}k" if abs(value) >= 1000 else f"{value:.1f}"


if __name__ == "__main__":
    app()
