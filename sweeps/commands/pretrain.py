"""A base checkpoint of mixed placements: `lidarplace pretrain grid.yaml --out base.pt`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lidarplace.base.errors import at
from lidarplace.command_line.terminal import output
from lidarplace.command_line.verbs import checked_input, new_app, verb, wrong
from lidarplace.files.atomic import check_replaceable, check_takes_files
from sweeps.execution.interrupted import interruptible
from sweeps.options import SetOption

if TYPE_CHECKING:
    from sweeps.configuration.grid import Sweep
    from sweeps.execution.failures import Failure
    from sweeps.stages.task import Task
    from sweeps.stages.train import FinetuneStage, TrainedDetector

app = new_app()


@verb(
    app,
    "examples/grid.yaml --out base.pt --set training.epochs=80",
    failed="the training or the machine failed",
)
def pretrain(
    configs: Annotated[list[Path], typer.Argument(help="YAML files of sweeps or searches")],
    out: Annotated[
        Path, typer.Option(metavar="FILE", help="file for the weights, such as base.pt")
    ],
    set_: SetOption = None,
) -> None:
    """Train one detector on the training clouds of many rigs together.

    The rigs are all placements of a sweep, or the generalist's rigs of a search, drawn from its
    zones. Several files add vehicles, towns and traffic; network, classes and training must agree.
    With `training.checkpoint: base.pt`, a sweep then starts every training from these weights,
    which favour no placement. All classes of the configuration are trained. If it already names the
    file to be written, the training starts from scratch. Scenes and clouds are kept in the store of
    the first file; a stopped training resumes at its last epoch."""
    from sweeps.execution.failures import Failure, FailureFolder
    from sweeps.execution.runner import run_tasks
    from sweeps.plan.pretrain_task import pretrain_task
    from sweeps.plan.pretrained import ON_GPU, uses_gpu
    from sweeps.stages.task import with_inputs
    from sweeps.store.open import reference, store_of

    if out.is_dir():  # before hours of training, not after
        wrong(f"--out {out}: is a folder; a file for the weights is expected")
    with checked_input():
        trainings = [_training(config, set_ or [], out) for config in configs]
        sweep = trainings[0][0]
        check_replaceable(out)
        out.parent.mkdir(parents=True, exist_ok=True)
        check_takes_files(out.parent)
        with at(", ".join(map(str, configs))):
            task = pretrain_task([training for _, training in trainings])
            store = store_of(sweep)
        tasks = with_inputs([task])
        store.refer(reference(sweep, "pretrain"), [needed.key for needed in tasks])
    console = output()
    logs = FailureFolder(sweep.common.output / sweep.common.name / "failed")
    say = partial(console.print, soft_wrap=True)
    if uses_gpu(sweep.common):
        say(ON_GPU)

    def trained() -> TrainedDetector | Failure:
        failures = run_tasks(console, sweep.common, store, tasks, logs)
        return failures[task.key] if task.key in failures else store.load(task)

    value = interruptible(console, trained)
    if isinstance(value, Failure):
        say(f"failed: {task.label}: {value.reason}")
        say(f"see {logs.folder}")
        raise typer.Exit(1)
    try:
        _write(out, task, value)
    except OSError as error:
        say(f"failed: {error}")
        raise typer.Exit(1) from None
    losses = value.curve.loc[value.curve["metric"] == "loss", "value"].tolist()
    say(
        f"{out}: {task.label}, classes {', '.join(value.classes)}, from {value.weights}, "
        f"loss {losses[0]:.3g} in the first of {len(losses)} epochs, {losses[-1]:.3g} in the last"
    )


def _write(out: Path, task: Task[FinetuneStage], trained: TrainedDetector) -> None:
    from sweeps.stages.collect import CollectStage
    from sweeps.stages.task import tasks_of
    from training.checkpoints import write_checkpoint
    from training.pretrained import domain_of

    stage, classes = task.stage, trained.classes
    rigs = [needed.stage.placement for needed in tasks_of(CollectStage, task.inputs)]
    domain = asdict(domain_of(rigs, stage.point_range, classes)) if rigs else None
    write_checkpoint(out, trained.state_dict, stage.detector, classes, stage.typical, domain)


def _training(
    config: Path, overrides: Sequence[str], out: Path
) -> tuple[Sweep, Task[FinetuneStage]]:
    from sweeps.configuration.grid import read_sweep
    from sweeps.plan.plan import read_plan
    from sweeps.plan.pretrain_task import training_of
    from sweeps.sweep_or_search import is_search

    if is_search(config):
        from sweeps.search.problem.generalist_trials import generalists
        from sweeps.search.problem.problem import read_problem  # Optuna

        problem = read_problem(config, overrides)
        return problem.sweep(), next(iter(generalists(problem).values()))
    checkpoints = [item.point.training.checkpoint for item in read_sweep(config, overrides).points]
    if any(path is not None and path.resolve() == out.resolve() for path in checkpoints):
        overrides = [*overrides, "training.checkpoint=null"]
    sweep, plan = read_plan(config, overrides)
    with at(config):
        return sweep, training_of(sweep, plan)
