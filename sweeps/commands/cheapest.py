"""The cheapest rig that meets all requirements: `lidarplace cheapest search.yaml`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from lidarplace.command_line.invocation import called
from lidarplace.command_line.terminal import output, say
from lidarplace.command_line.verbs import JsonOption, checked_input, new_app, print_json, verb
from sweeps.options import DryRunOption, SetOption

app = new_app()


@verb(
    app,
    "examples/cheapest.yaml",
    "examples/cheapest.yaml --set search.cheapest.by=lidars",
    failed="no rig of the grid meets everything, or none was found in time",
)
def cheapest(
    config: Annotated[Path, typer.Argument(help="YAML file of a search")],
    set_: SetOption = None,
    dry_run: DryRunOption = False,
    as_json: JsonOption = False,
) -> None:
    """Find the cheapest rig that meets all requirements, by LiDARs, price, power or height.

    Solves the grid of candidates of a search, with a proof or a bound, then refines the rig off the
    grid. Needs no traffic, unless search.cheapest.recall is set. Writes
    placement.yaml and a page, cheapest.html."""
    from sweeps.results.origin import record_origin
    from sweeps.search.cheapest.choose import cheapest as choose
    from sweeps.search.cheapest.choose import check
    from sweeps.search.cheapest.page import write_cheapest_page
    from sweeps.search.cheapest.polish import polish
    from sweeps.search.cheapest.result import CheapestAnswer, print_answer, write_answer
    from sweeps.search.cheapest.result import as_json as answer_json
    from sweeps.search.problem.problem import read_problem
    from sweeps.search.verification.reevaluation import recall_of
    from sweeps.store.open import store_of

    console = output()
    os.environ["MLFLOW_DISABLE_TELEMETRY"] = "true"  # before anything imports it
    with checked_input():
        problem = read_problem(config, set_ or [])
        summary = check(problem)
        if dry_run:
            say(summary) if not as_json else print_json({"summary": summary})
            return
        record_origin(sweep := problem.sweep())
        recall = recall_of(console, problem, store_of(sweep))
    if not as_json:
        say(summary)
    with checked_input():
        chosen = choose(problem, recall)
    rig = None if chosen.rig is None else polish(problem, chosen.rig, recall)
    answer = CheapestAnswer(problem, chosen, rig, called(), recall)
    folder = write_answer(answer)
    write_cheapest_page(answer, folder)
    if as_json:
        print_json(answer_json(answer))
    else:
        print_answer(console, answer, folder)
    if rig is None:
        raise typer.Exit(1)
