"""Small stages and their results, listeners, and checkpoints."""

from dataclasses import dataclass, make_dataclass
from typing import Any

from typer.testing import CliRunner

from lidarplace.files.atomic import replacing
from sweeps.stages.stage import Stage


@dataclass(frozen=True)
class Toy:
    n: Any = None


@dataclass(frozen=True)
class SceneToy(Stage[Toy]):
    """Adds the numbers of its inputs."""

    n: Any = None

    name = "scene"
    order = 70

    def run(self, *inputs) -> Toy:
        return Toy(self.n + sum(number.n for number in inputs))


class CollectToy(SceneToy):
    name = "collect"
    order = 50


class PogToy(SceneToy):
    name = "pog"
    order = 80


class EvaluateToy(SceneToy):
    name = "evaluate"
    order = 20


class TrainingToy(SceneToy):
    name = "finetune"
    order = 30
    resumable = True


def call(app, *words, code=0, **how):
    """Call a command in this process; what it did, after a look at its exit code."""
    done = CliRunner().invoke(app, [*map(str, words)], **how)
    assert done.exit_code == code, (done.output, done.exception)
    return done


def ran(sweep, folder):
    """Run a sweep in this process: its plan, its store, and the folder of its tables."""
    from sweeps.execution.backends import InProcess
    from sweeps.execution.execute import Outcome, execute
    from sweeps.plan.plan import make_plan
    from sweeps.results.promotion import Promotion
    from sweeps.results.run_folder import Run, write_run
    from sweeps.store.local import Store

    plan, store, outcome = make_plan(sweep), Store(folder / "runs/store"), Outcome()
    execute(plan.tasks, store, InProcess(), Loud(), outcome)
    run = Run(outcome, Promotion(complete=True), set(), 1, "run grid.yaml", 0.0, 1.0)
    write_run(folder / "run", sweep, plan, store, run)
    return plan, store, folder / "run"


def result(**fields):
    """A result of these fields, such as some of a stage's."""
    return make_dataclass("Made", fields)(**fields)


def keep_in(patch, stage, kind):
    """A store reads results of the stage as those of a class."""
    patch.setattr(stage, "result", classmethod(lambda cls: kind))


def flip_bit(path, place):
    """Change one bit of a file, as a bad disk does; 0 is the first byte, 1 the last."""
    data = bytearray(path.read_bytes())
    data[round(place * (len(data) - 1))] ^= 1
    path.write_bytes(data)


def write(path, text):
    """A checkpoint."""
    with replacing(path) as partial:
        partial.write_text(text)


def texts(folder):
    """Checkpoints by name."""
    return {path.name: path.read_text() for path in folder.glob("[!.]*")}


class Quiet:
    """A listener that keeps nothing."""

    def started(self, task): ...
    def finished(self, task): ...
    def failed(self, task, failure): ...


class Loud(Quiet):
    """A listener that takes no failure."""

    def failed(self, task, failure):
        raise AssertionError(f"{task.label}: {failure.reason}\n{failure.log}")
