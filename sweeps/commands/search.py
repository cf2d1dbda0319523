"""The command: `lidarplace search search.yaml`."""

import os
from pathlib import Path
from typing import Annotated

import typer

from lidarplace.command_line.invocation import called
from lidarplace.command_line.terminal import output
from lidarplace.command_line.verbs import JsonOption, checked_input, new_app, print_json, verb
from sweeps.execution.interrupted import interruptible
from sweeps.options import DryRunOption, SchemaOption, SetOption, given

app = new_app()


@verb(
    app,
    "examples/search.yaml",
    "examples/search.yaml --set search.trials=50 --no-verify",
    failed="no feasible placement, trainings or the machine failed, or MLflow is incomplete",
)
def search(
    config: Annotated[Path | None, typer.Argument(help="YAML file of a search")] = None,
    set_: SetOption = None,
    dry_run: DryRunOption = False,
    verify: Annotated[
        bool, typer.Option(help="train detectors for the winners (key verify)")
    ] = True,
    schema: SchemaOption = False,
    as_json: JsonOption = False,
) -> None:
    """Search for the best placement by a surrogate, or by a detector's measured AP or recall.

    The same command resumes a stopped search, or continues one with more trials."""
    from sweeps.configuration.search import SearchFile

    if schema:
        print_json(SearchFile.model_json_schema())
        return
    config = given(config, "search", "examples/search.yaml", as_json and not dry_run)
    from sweeps.search.greedy.candidates import check_grid
    from sweeps.search.greedy.certificate import why_none
    from sweeps.search.output.terminal import planned, print_problem
    from sweeps.search.problem.problem import read_problem

    with checked_input():
        problem = read_problem(config, set_ or [])
        if why_none(problem) is None:
            check_grid(problem)
        problem.check_memory()
    if as_json:
        print_json(planned(problem))
        return
    console = output()
    print_problem(console, problem)
    if dry_run:
        return
    os.environ["MLFLOW_DISABLE_TELEMETRY"] = "true"  # before anything imports it
    from sweeps.search.adapt import first_round, second_round
    from sweeps.search.run import run_search
    from sweeps.store.open import check_writable, store_of

    with checked_input():
        sweep = problem.sweep()
        store = store_of(sweep)
        check_writable(sweep, store)
    if problem.file.search.adapt is not None:
        with checked_input():
            first = first_round(problem, config, set_ or [])
        if not interruptible(console, lambda: run_search(console, first, store, called(), False)):
            raise typer.Exit(1)
        with checked_input():
            problem = second_round(problem, first, config, set_ or [])
        print_problem(console, problem)
    if not interruptible(console, lambda: run_search(console, problem, store, called(), verify)):
        raise typer.Exit(1)
