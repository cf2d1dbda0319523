"""The main job: `lidarplace run grid.yaml`."""

import os
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from lidarplace.command_line.invocation import called
from lidarplace.command_line.terminal import output, say
from lidarplace.command_line.verbs import JsonOption, checked_input, new_app, print_json, verb
from sweeps.configuration.sweep import SweepFile
from sweeps.execution.interrupted import interruptible
from sweeps.execution.memory import check_memory
from sweeps.options import DryRunOption, SchemaOption, SetOption, given
from sweeps.plan.plan import read_plan
from sweeps.results.dry_run import describe_dry_run, print_dry_run
from sweeps.results.origin import check_origin
from sweeps.results.rigs import write_rigs_page
from sweeps.store.open import check_writable, store_of

app = new_app()


@verb(
    app,
    "examples/grid.yaml",
    "examples/grid.yaml --set training.epochs=2 --dry-run",
    failed="trials failed, the machine failed, or MLflow is incomplete",
)
def run(
    config: Annotated[Path | None, typer.Argument(help="YAML file of a sweep")] = None,
    set_: SetOption = None,
    dry_run: DryRunOption = False,
    rerun_failed: Annotated[
        bool, typer.Option("--rerun-failed", help="retry failures by data or settings, too")
    ] = False,
    schema: SchemaOption = False,
    as_json: JsonOption = False,
) -> None:
    """Run a sweep: scenes, surrogates, point clouds, detectors, MLflow, report.

    The same command resumes a stopped sweep. Failures of the machine are retried, failures by data
    or settings only with --rerun-failed."""
    if schema:
        print_json(SweepFile.model_json_schema())
        return
    config = given(config, "sweep", "examples/grid.yaml", as_json and not dry_run)
    with checked_input():
        sweep, plan = read_plan(config, set_ or [])
        store = store_of(sweep)
        finished = store.finished(plan.tasks)
        to_do = [task for task in plan.tasks if task.key not in finished]
        check_memory(to_do, sweep.common.ray.address)
    console = output()
    if dry_run:
        with checked_input():
            check_origin(sweep)
            described = describe_dry_run(sweep, plan, store)
            page = None if as_json else write_rigs_page(sweep, described.cautions)
        if as_json:
            print_json(asdict(described))
        else:
            print_dry_run(console, described)
            say(f"rigs drawn: {page}")
        return
    os.environ["MLFLOW_DISABLE_TELEMETRY"] = "true"  # before anything imports it
    from sweeps.run_sweep import run_sweep

    with checked_input():
        check_writable(sweep, store)
    arguments = (sweep, plan, store, called(), rerun_failed)
    if not interruptible(console, lambda: run_sweep(console, *arguments)):
        raise typer.Exit(1)
