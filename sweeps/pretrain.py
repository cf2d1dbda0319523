"""A base checkpoint of mixed placements: `python -m sweeps.pretrain grid.yaml --out base.pt`."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from lidarplace.command_line import output, wrong
from sweeps.config_file import ConfigError
from sweeps.failures import Failure, FailureFolder
from sweeps.grid import Sweep, read_sweep
from sweeps.plan import Plan, read_plan
from sweeps.progress import StageProgress
from sweeps.sweep_store import reference, store_of
from sweeps.task import Task

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)

_MIXED = ("placement", "lidar", "seed", "surrogate")
"""Axes that may have several values: those of the rig are mixed, the others do not matter."""


@app.command()
def pretrain(
    config: Annotated[Path, typer.Argument(help="YAML file of a sweep")],
    out: Annotated[Path, typer.Option(help="file for the weights, such as base.pt")],
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="override a key path")
    ] = None,
) -> None:
    """Train the detector of a sweep on the training clouds of all its placements together.

    A sweep then starts every training from the same weights, which favour no placement, with
    `training.checkpoint: base.pt`. All classes of the configuration are trained; where it names
    the file to be written already, the base starts from scratch. Scenes and clouds come from the
    sweep's store and stay there; one that is stopped goes on at its last epoch. Exit code 0: the
    file is there; 1: something failed; 2: the configuration is wrong; 130: stopped by Ctrl-C.

    Example: python -m sweeps.pretrain grid.yaml --out base.pt --set training.epochs=80
    """
    from sweeps.backends import BackendLost, backend_for
    from sweeps.execute import execute
    from sweeps.ray_cluster import ClusterError
    from training.checkpoints import write_checkpoint

    overrides = set_ or []
    try:
        checkpoints = [
            item.point.training.checkpoint for item in read_sweep(config, overrides).points
        ]
        if any(path is not None and path.resolve() == out.resolve() for path in checkpoints):
            overrides = [*overrides, "training.checkpoint=null"]
        sweep, plan = read_plan(config, overrides)
        out.parent.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=out.parent).close()  # before hours of training, not after
    except (ConfigError, OSError) as error:
        wrong(error)
    try:
        task = pretrain_task(sweep, plan)
        store = store_of(sweep)
    except ValueError as error:
        wrong(f"{config}: {error}")
    tasks = with_inputs(task)
    store.refer(reference(sweep, "pretrain"), [needed.key for needed in tasks])
    console = output()
    logs = FailureFolder(sweep.common.output / sweep.common.name / "failed")
    try:
        with (
            store.in_use(),
            backend_for(sweep.common.ray, store) as backend,
            StageProgress(console, tasks, store.finished(tasks)) as progress,
        ):
            failures = execute(tasks, store, backend, _Listener(progress, logs)).failures
    except ClusterError as error:
        wrong(error)
    except (BackendLost, OSError) as error:
        console.print(f"{error}. The same command goes on.", markup=False, soft_wrap=True)
        raise typer.Exit(1) from None
    except KeyboardInterrupt:
        console.print("\nStopped. The same command goes on from the last epoch.")
        raise typer.Exit(130) from None
    if task.key in failures:
        reason = failures[task.key].reason
        console.print(f"failed: {task.label}: {reason}", markup=False, soft_wrap=True)
        console.print(f"see {logs.folder}", markup=False, soft_wrap=True)
        raise typer.Exit(1)
    value = store.load(task)
    try:
        write_checkpoint(out, value["state_dict"], task.params["detector"], value["classes"])
    except OSError as error:
        console.print(f"failed: {error}", markup=False, soft_wrap=True)
        raise typer.Exit(1) from None
    curve = value["curve"]
    losses = curve.loc[curve["metric"] == "loss", "value"].tolist()
    console.print(
        f"{out}: {task.label}, classes {', '.join(value['classes'])}, from {value['weights']}, "
        f"loss {losses[0]:.3g} in the first of {len(losses)} epochs, {losses[-1]:.3g} in the last",
        markup=False,
        highlight=False,
        soft_wrap=True,
    )


@dataclass(frozen=True)
class _Listener:
    """Shows how far the tasks are, and keeps the tracebacks of those that fail."""

    progress: StageProgress
    failures: FailureFolder

    def started(self, task: Task) -> None:
        self.progress.started(task)

    def finished(self, task: Task) -> None:
        self.progress.finished(task)

    def failed(self, task: Task, failure: Failure) -> None:
        self.progress.failed(task, failure)
        self.failures.write(task, failure)


def pretrain_task(sweep: Sweep, plan: Plan) -> Task:
    """The training on the clouds of all placements of a sweep, with the seed of its first point.

    Raises:
        ConfigError: there is no detector, or the grid has several detectors, trainings, scenes,
            ROIs or lists of classes.
    """
    for axis in sweep.axes:
        # A value may be a list or a mapping.
        values = {repr(grid_point.axes[axis]) for grid_point in sweep.points}
        if axis.partition(".")[0] not in _MIXED and len(values) > 1:
            raise ConfigError(
                f"grid.{axis}: a base is trained for one value, found {', '.join(sorted(values))}; "
                f"choose with --set 'grid.{axis}=[…]'"
            )
    trainings = [trial.finetune for trial in plan.trials if trial.finetune is not None]
    if not trainings:
        raise ConfigError("detector: null trains nothing; name the detector of the base")
    inputs = {needed.key: needed for training in trainings for needed in training.inputs}
    placements = {trial.grid_point.point.placement for trial in plan.trials}
    params = trainings[0].params
    return Task(
        "pretrain",
        f"{params['detector']} · {len(placements)} placements",
        {**params, "point_range": _around([task.params["point_range"] for task in trainings])},
        tuple(inputs.values()),
        gpu=True,
        resumable=True,
    )


def with_inputs(task: Task) -> list[Task]:
    """All tasks that `task` needs, each once and after its inputs, and `task` itself."""
    found: dict[str, Task] = {}
    for needed in task.inputs:
        found |= {item.key: item for item in with_inputs(needed) if item.key not in found}
    return [*found.values(), task]


def _around(ranges: Sequence[Sequence[float]]) -> tuple[float, ...]:
    """The smallest range that holds all."""
    low, high = zip(*((item[:3], item[3:]) for item in ranges), strict=True)
    return (*map(min, zip(*low, strict=True)), *map(max, zip(*high, strict=True)))


if __name__ == "__main__":
    app()
