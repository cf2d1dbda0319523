"""Where a sweep or a search stands: `python -m sweeps.status grid.yaml`."""

from __future__ import annotations

import sys
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from lidarplace.command_line.terminal import output
from lidarplace.command_line.verbs import JsonOption, new_app, print_json, verb, wrong
from sweeps.options import SetOption

app = new_app()


@verb(app, "examples/grid.yaml", "examples/search.yaml --json")
def status(
    config: Annotated[Path, typer.Argument(help="YAML file of a sweep or a search")],
    set_: SetOption = None,
    all_: Annotated[bool, typer.Option("--all", help="list every trial, however many")] = False,
    as_json: JsonOption = False,
) -> None:
    """Show where a sweep or a search stands, also while it runs. Runs nothing.

    Of a sweep the tasks by stage and the trials; of many trials, without --all, those that run or
    failed. Of a search its trials, the best so far and the trainings of `verify`.
    """
    from sweeps.plan.plan import read_plan
    from sweeps.print_state import print_search, print_state
    from sweeps.results.state import sweep_state
    from sweeps.store.damage import until_whole
    from sweeps.store.of_sweep import store_of
    from sweeps.sweep_or_search import is_search

    overrides = set_ or []
    say = partial(print, file=sys.stderr)
    try:
        if is_search(config):
            from sweeps.search.output.state import search_state
            from sweeps.search.problem.problem import read_problem  # Optuna

            problem = read_problem(config, overrides)
            found = until_whole(lambda: search_state(problem), say)
            if as_json:
                print_json({"kind": "search"} | asdict(found))
            else:
                print_search(output(), found, all_)
            return
        sweep, plan = read_plan(config, overrides)
        store = store_of(sweep)
        state = until_whole(lambda: sweep_state(sweep, plan, store), say)
    except (ValueError, OSError) as error:
        wrong(error)
    if as_json:
        print_json({"kind": "sweep"} | asdict(state))
    else:
        print_state(output(), state, all_)


if __name__ == "__main__":
    app()
