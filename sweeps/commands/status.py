"""State of a sweep or a search: `lidarplace status grid.yaml`."""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from lidarplace.base.number_text import number
from lidarplace.command_line.invocation import command
from lidarplace.command_line.terminal import output
from lidarplace.command_line.verbs import JsonOption, checked_input, new_app, print_json, verb
from lidarplace.files.secret_urls import hide_secrets
from sweeps.options import SetOption

if TYPE_CHECKING:
    from sweeps.results.state import Status, SweepState
    from sweeps.search.output.state import SearchState

_MOST_TRIALS = 40
_MOST_BEST = 5
_STATUSES: tuple[Status, ...] = ("done", "running", "stopped", "waiting", "failed", "pruned")
_COLOURS = {"done": "green", "running": "cyan", "stopped": "yellow", "failed": "red"}

app = new_app()


@verb(app, "examples/grid.yaml", "examples/search.yaml --json")
def status(
    config: Annotated[Path, typer.Argument(help="YAML file of a sweep or a search")],
    set_: SetOption = None,
    all_: Annotated[bool, typer.Option("--all", help="list all trials")] = False,
    as_json: JsonOption = False,
) -> None:
    """Show the progress of a sweep or a search, even while it runs. Runs nothing.

    For a sweep: tasks by stage, and trials; a long list has only running and failed ones without
    --all. For a search: trials, the best so far and the trainings of `verify`."""
    from sweeps.execution.interrupted import until_whole
    from sweeps.plan.plan import read_plan
    from sweeps.results.state import sweep_state
    from sweeps.store.open import store_of
    from sweeps.sweep_or_search import is_search

    overrides = set_ or []
    sets = [word for pair in map(hide_secrets, overrides) for word in ("--set", pair)]
    say = partial(print, file=sys.stderr)
    with checked_input():
        if is_search(config):
            from sweeps.search.output.state import search_state
            from sweeps.search.problem.problem import read_problem  # Optuna

            problem = read_problem(config, overrides)
            search_status = until_whole(lambda: search_state(problem), say)
            if as_json:
                print_json({"kind": "search"} | asdict(search_status))
            else:
                print_search(output(), search_status, all_, problem.folder)
            return
        sweep, plan = read_plan(config, overrides)
        store = store_of(sweep)
        state = until_whole(lambda: sweep_state(sweep, plan, store), say)
    if as_json:
        print_json({"kind": "sweep"} | asdict(state))
    else:
        print_state(output(), state, all_, command("run", str(config), *sets, "--rerun-failed"))


def print_state(console: Console, state: SweepState, every: bool, again: str) -> None:
    """Print tables of stages and trials; of many trials, unless `every`, running and failed ones.

    `again` is the command that retries all failures."""
    by_status = Counter(trial.status for trial in state.trials)
    counts = ", ".join(f"{by_status[name]} {name}" for name in _STATUSES if by_status[name])
    console.print(f"{state.name}: {_alive(state.alive)}; {len(state.trials)} trials: {counts}")
    table = Table()
    table.add_column("stage")
    statuses = [name for name in _STATUSES if any(name in n for n in state.stages.values())]
    for name in statuses:
        table.add_column(name, justify="right", style=_COLOURS.get(name))
    for stage, numbers in state.stages.items():
        table.add_row(stage, *(str(numbers.get(name, "")) for name in statuses))
    console.print(table)
    trials = state.trials
    if len(trials) > _MOST_TRIALS and not every:
        trials = [t for t in trials if t.status in ("running", "stopped", "failed")]
    if trials:
        table = Table("trial", "status", "")
        for trial in trials:
            detail = trial.detail + (f"\n{trial.log}" if trial.log else "")
            table.add_row(trial.label, Text(trial.status, _COLOURS.get(trial.status, "")), detail)
        console.print(table)
    if len(trials) < len(state.trials):
        console.print(f"{len(state.trials) - len(trials)} more trials: --all lists them")
    if by_status["failed"]:
        console.print(f"To retry permanent failures: {again}", soft_wrap=True)


def print_search(console: Console, state: SearchState, every: bool, folder: Path) -> None:
    """Print the number of trials, the best of them, failures, and the state of `verify`."""
    trials = state.trials
    console.print(
        f"{state.name}: {_alive(state.alive)}; {trials['done']} of {trials['wanted']} trials "
        f"done, {trials['feasible']} keep all constraints, {trials['failed']} failed"
    )
    stride = state.azimuth_stride
    rays = f" (as searched, rays of 1 in {stride} azimuth steps)" if stride > 1 else ""
    best = state.best if every else state.best[:_MOST_BEST]
    for trial in best:
        values = ", ".join(f"{name} {number(value)}" for name, value in trial["values"].items())
        console.print(f"best so far: trial {trial['trial']}: {values}{rays}")
    if len(best) < len(state.best):
        console.print(f"{len(state.best) - len(best)} more of the Pareto front: --all lists them")
    for failure in state.failures:
        console.print(f"trial {failure['trial']} failed: {failure['reason']}", soft_wrap=True)
    if state.verify is not None:
        console.print()
        again = command("run", str(folder / "sweep.yaml"), "--rerun-failed")
        print_state(console, state.verify, every, again)


def _alive(alive: bool) -> str:
    return "running" if alive else "no driver runs"
