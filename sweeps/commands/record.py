"""The scenes of a sweep as box logs: `lidarplace record grid.yaml logs`."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer

from lidarplace.command_line.terminal import output
from lidarplace.command_line.verbs import checked_input, new_app, verb
from sweeps.execution.interrupted import interruptible
from sweeps.options import SetOption

app = new_app()


@verb(app, "examples/paper.yaml logs/paper", failed="scenes or the machine failed")
def record(
    config: Annotated[Path, typer.Argument(help="YAML file of a sweep")],
    out: Annotated[Path, typer.Argument(help="folder for a box log of every scene of the grid")],
    set_: SetOption = None,
) -> None:
    """Record the scenes of a sweep, towns in parallel, and write them as box logs.

    Only the scenes of the file matter. A sweep of the same file finds them in its store."""
    from lidarplace.commands.describe import print_description
    from lidarplace.logs.box_log import BoxLog, join_logs, write_box_log
    from sweeps.execution.runner import run_tasks
    from sweeps.plan.plan import read_plan
    from sweeps.store.open import reference, store_of

    with checked_input():
        sweep, plan = read_plan(config, set_ or [])
        store = store_of(sweep)
        out.mkdir(parents=True, exist_ok=True)  # before traffic is simulated for it
        tasks = [task for task in plan.tasks if task.stage.name == "scene"]
        store.refer(reference(sweep, "record"), [task.key for task in tasks])
    scenes = {trial.scenes: trial.scene_label for trial in plan.trials}
    console = output()

    def recorded() -> tuple[list[tuple[str, BoxLog]], bool]:
        """The log of every scene that did not fail, and whether none failed."""
        failures = run_tasks(console, sweep.common, store, tasks)
        logs = [
            (label, join_logs([store.load(part) for part in parts]))
            for parts, label in scenes.items()
            if not any(part.key in failures for part in parts)
        ]
        return logs, not failures

    logs, complete = interruptible(console, recorded)
    for label, log in logs:
        folder = out / re.sub(r"[^\w.=-]+", "_", label)
        with checked_input():
            write_box_log(folder, log)
        print_description(log, str(folder))
    if not complete:
        raise typer.Exit(1)
