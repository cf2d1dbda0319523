"""The command: `python -m sweeps.search search.yaml`."""

from __future__ import annotations

import json
import os
import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer

from lidarplace.command_line import output, wrong
from sweeps.result_folder import DamagedResult
from sweeps.search.settings import SearchFile

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def search(
    config: Annotated[Path | None, typer.Argument(help="YAML file of the search")] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="override a key path")
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="print the plan and stop")] = False,
    verify: Annotated[
        bool, typer.Option(help="train detectors for the winners, as `verify` says")
    ] = True,
    schema: Annotated[bool, typer.Option("--schema", help="print the JSON schema")] = False,
) -> None:
    """Search for the placement that is best by a surrogate, or by a detector's measured AP.

    The same command continues a search that was stopped, or that is given more trials.

    Example: python -m sweeps.search examples/search.yaml

    Exit code 0: found; 1: no placement keeps all constraints, or trainings failed; 2: the
    configuration is wrong; 130: stopped by Ctrl-C.
    """
    console = output()
    if schema:
        print(json.dumps(SearchFile.model_json_schema(), indent=2))
        return
    if config is None:
        wrong("name a configuration file, such as examples/search.yaml")
    from sweeps.search.certificate import check_candidates
    from sweeps.search.problem import read_problem

    try:
        problem = read_problem(config, set_ or [])
        check_candidates(problem)
    except ValueError as error:
        wrong(error)
    from sweeps.backends import BackendLost
    from sweeps.search.run import run_search
    from sweeps.search.show import print_problem

    print_problem(console, problem)
    if dry_run:
        return
    command = shlex.join(["python", "-m", "sweeps.search", *sys.argv[1:]])
    goes_on = "What is finished is kept; the same command goes on from there."
    try:
        found = run_search(console, problem, command, verify)
    except (BackendLost, DamagedResult, OSError) as error:
        console.print(f"\n{error}. {goes_on}", markup=False, soft_wrap=True)
        raise typer.Exit(1) from None
    except KeyboardInterrupt:
        console.print(f"\nStopped. {goes_on}")
        raise typer.Exit(130) from None
    if not found:
        raise typer.Exit(1)


if __name__ == "__main__":
    os.environ["MLFLOW_DISABLE_TELEMETRY"] = "true"
    app()
