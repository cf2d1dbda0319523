"""Where a sweep stands: `python -m sweeps.status grid.yaml`."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from lidarplace.command_line import output, wrong
from sweeps.plan import read_plan
from sweeps.state import Status, SweepState, sweep_state
from sweeps.sweep_store import store_of

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)

_MOST_TRIALS = 40
_STATUSES: tuple[Status, ...] = ("done", "running", "stopped", "waiting", "failed", "pruned")
_COLOURS = {"done": "green", "running": "cyan", "stopped": "yellow", "failed": "red"}


@app.command()
def status(
    config: Annotated[Path, typer.Argument(help="YAML file of the sweep")],
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="override a key path")
    ] = None,
    all_: Annotated[
        bool, typer.Option("--all", help=f"list every trial, also of more than {_MOST_TRIALS}")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="for a script")] = False,
) -> None:
    """Show where a sweep stands, by stage and by trial. Runs nothing, also while the sweep runs.

    Exit code 0; 2: the configuration is wrong.

    Example: python -m sweeps.status grid.yaml
    """
    try:
        sweep, plan = read_plan(config, set_ or [])
        state = sweep_state(sweep, plan, store_of(sweep))
    except (ValueError, OSError) as error:
        wrong(error)
    if as_json:
        print(json.dumps(asdict(state), indent=1, ensure_ascii=False))
    else:
        print_state(output(), state, all_)


def print_state(console: Console, state: SweepState, every: bool) -> None:
    """Print tables of stages and trials; of many trials, unless `every`, what runs or failed."""
    by_status = Counter(trial.status for trial in state.trials)
    counts = ", ".join(f"{by_status[name]} {name}" for name in _STATUSES if by_status[name])
    console.print(
        f"{state.name}: {'running' if state.alive else 'no driver runs'}; {len(state.trials)} "
        f"trials: {counts}",
        highlight=False,
    )
    table = Table()
    table.add_column("stage")
    shown = [name for name in _STATUSES if any(name in own for own in state.stages.values())]
    for name in shown:
        table.add_column(name, justify="right", style=_COLOURS.get(name))
    for stage, own in state.stages.items():
        table.add_row(stage, *(str(own.get(name, "")) for name in shown))
    console.print(table)
    trials = state.trials
    if len(trials) > _MOST_TRIALS and not every:
        trials = [t for t in trials if t.status in ("running", "stopped", "failed")]
    if trials:
        table = Table("trial", "status", "")
        for trial in trials:
            colour = _COLOURS.get(trial.status, "default")
            detail = trial.detail + (f"\n{trial.log}" if trial.log else "")
            label, detail = (text.replace("[", r"\[") for text in (trial.label, detail))
            table.add_row(label, f"[{colour}]{trial.status}[/]", detail)
        console.print(table)
    if len(trials) < len(state.trials):
        console.print(f"{len(state.trials) - len(trials)} more trials: --all lists them")
    if by_status["failed"]:
        console.print("What failed for good is tried again by sweeps.run with --rerun-failed.")


if __name__ == "__main__":
    app()
