"""Check that everything is installed that a sweep needs: `lidarplace doctor [grid.yaml]`."""

import shlex
import shutil
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from lidarplace.base.optional import needs
from lidarplace.command_line.terminal import output, visible
from lidarplace.command_line.verbs import (
    JsonOption,
    checked_input,
    new_app,
    print_json,
    verb,
    wrong,
)
from lidarplace.files.secret_urls import public_url
from sweeps.execution import checks
from sweeps.execution.checks import CheckResult
from sweeps.options import SetOption

app = new_app()

_SIGNS = {
    "good": Text("✓", "green"),
    "weak": Text("!", "yellow"),
    "optional": Text("–", "dim"),
    "missing": Text("✗", "red"),
}


@dataclass(frozen=True, kw_only=True)
class Finding(CheckResult):
    """A checked thing, its state, and what does not work without it."""

    check: str
    needed_for: str


@dataclass(frozen=True)
class MachineNeeds:
    """Needs of a configuration; the defaults without one.

    `folder` is that of the store, or of the copies from a remote one, whose URL is `store`."""

    path: Path | None = None
    overrides: tuple[str, ...] = ()
    run_folder: Path = Path("runs")
    folder: Path = Path("runs/store")
    store: str | None = None
    tracking_uri: str = "sqlite:///runs/mlflow.db"
    ray: str = "local"
    gpu: bool = False
    sumo: bool = True

    @property
    def cleaned(self) -> str:
        """Argument of `lidarplace clean`: the file, or the store, as it knows no overrides."""
        if self.path and not self.overrides:
            return str(self.path)
        return self.store or str(self.folder)


@verb(app, "", "examples/grid.yaml --json", failed="a requirement is missing")
def doctor(
    config: Annotated[
        Path | None, typer.Argument(metavar="CONFIG", help="YAML file of a sweep or a search")
    ] = None,
    set_: SetOption = None,
    as_json: JsonOption = False,
) -> None:
    """Check whether everything that a sweep needs is installed, and print how to install the rest.

    Servers are contacted only if the configuration names them."""
    if set_ and config is None:
        wrong("--set: name the configuration file, too")
    try:
        findings = find_all(machine_needs(config, set_ or []) if config else MachineNeeds())
    except ImportError as error:  # a package is missing without which no file can be read
        unread = CheckResult(f"cannot be read: {error}", "missing", "make setup")
        findings = [*find_all(MachineNeeds()), _finding(str(config), "this sweep", unread)]
    if as_json:
        print_json([asdict(finding) for finding in findings])
    else:
        _print(output(), findings)
    if any(finding.state == "missing" for finding in findings):
        raise typer.Exit(1)


def machine_needs(config: Path, overrides: Sequence[str] = ()) -> MachineNeeds:
    """Read the needs of a file with `overrides`; exits with code 2 if it is wrong."""
    from lidarplace.scenes.sumo.settings import SumoScene
    from sweeps.sweep_or_search import read_either

    with checked_input():
        sweep = read_either(config, overrides)
    common = sweep.common
    url = common.store.url
    remote = url is not None and "://" in url
    return MachineNeeds(
        path=config,
        overrides=tuple(overrides),
        run_folder=common.output / common.name,
        folder=Path((common.store.cache if remote else url) or common.output / "store"),
        store=url if remote else None,
        tracking_uri=common.tracking_uri,
        ray=common.ray.address,
        gpu=bool(common.ray.num_gpus),
        sumo=any(isinstance(point.point.scene, SumoScene) for point in sweep.points),
    )


def find_all(machine: MachineNeeds) -> list[Finding]:
    """Run all checks, in the order in which things are needed; none stops the others."""
    wanted: list[tuple[str, str, Callable[[], CheckResult]]] = [
        ("packages", "everything", partial(checks.packages, None, True)),
        ("sweeps", "detectors, sweeps", partial(checks.packages, "sweeps", True)),
        ("GPU", "fast trainings", partial(checks.gpu, machine.gpu)),
        ("memory", "a training on every CPU, some 2 GB each", checks.memory),
        ("shared memory", "Ray's object store, 0.1 GB or more", checks.shared_memory),
        ("Ray", "parallel tasks", partial(checks.ray, machine.ray)),
        ("SUMO", "simulated traffic (scene.source: sumo)", partial(checks.sumo, machine.sumo)),
        _disk("run folder", machine.run_folder, machine),
        _disk("copies" if machine.store else "store", machine.folder, machine),
    ]
    if machine.store:
        purpose = f"results in {public_url(machine.store)}"
        wanted.append(("store", purpose, partial(checks.remote_store, machine.store)))
    wanted.append(("MLflow", "logging of trials", partial(checks.mlflow, machine.tracking_uri)))
    if machine.path:
        from sweeps.sweep_or_search import is_search

        kind = "this search" if is_search(machine.path) else "this sweep"
        wanted.append(("scenes", kind, partial(scenes, machine.path, machine.overrides)))
    postgres = machine.tracking_uri.startswith("postgres")
    for extra, name, needed_for, needed in (
        ("cluster", "Ray client", "ray: ray://…", machine.ray.startswith("ray://")),
        ("postgres", "PostgreSQL driver", "MLflow in PostgreSQL", postgres),
        ("s3", "S3 client", "store: s3://…", (machine.store or "").startswith("s3")),
        ("carla", "CARLA client", "point clouds from a CARLA server", False),
    ):
        wanted.append((name, needed_for, partial(checks.packages, extra, needed)))
    return [_tried(*one) for one in wanted]


def _disk(
    kind: str, folder: Path, machine: MachineNeeds
) -> tuple[str, str, Callable[[], CheckResult]]:
    return f"disk: {kind}", f"results in {folder}", partial(checks.disk, folder, machine.cleaned)


def scenes(config: Path, overrides: Sequence[str] = ()) -> CheckResult:
    """Check that the maps, logs and checkpoints that the file names exist."""
    from sweeps.execution.memory import check_memory
    from sweeps.plan.plan import read_plan
    from sweeps.stages.command import CommandStage
    from sweeps.stages.task import tasks_of
    from sweeps.sweep_or_search import is_search

    try:
        if is_search(config):
            from sweeps.search.problem.problem import read_problem

            problem = read_problem(config, overrides)
            problem.check_memory()
            return CheckResult(f"{problem.file.search.trials} trials")
        sweep, plan = read_plan(config, overrides)
        check_memory(plan.tasks, sweep.common.ray.address)
    except ValueError as error:
        return CheckResult(" ".join(str(error).split()), "missing", f"correct {config}")
    for evaluator in {task.stage.evaluator for task in tasks_of(CommandStage, plan.tasks)}:
        program = shlex.split(evaluator.command)[0]
        place = str(evaluator.folder / program) if "/" in program else program
        if program != "{python}" and shutil.which(place) is None:
            fault = f"evaluator.command: no program {program}; found none at {place}"
            return CheckResult(fault, "missing", "install it, or correct evaluator.command")
    return CheckResult(f"{len(plan.trials)} trials, {len(plan.tasks)} tasks")


def _tried(name: str, needed_for: str, check: Callable[[], CheckResult]) -> Finding:
    """Return the finding of a check; its failure is a finding too."""
    try:
        result = check()
    except Exception as error:
        text = " ".join(f"{type(error).__name__}: {error}".split())
        remedy = needs(error) if isinstance(error, ModuleNotFoundError) else None
        result, needed_for = CheckResult(text, "missing", remedy or "make setup"), "see the message"
    return _finding(name, needed_for, result)


def _finding(check: str, needed_for: str, result: CheckResult) -> Finding:
    return Finding(**vars(result), check=check, needed_for=needed_for)


def _print(console: Console, findings: list[Finding]) -> None:
    table = Table(box=None, pad_edge=False, header_style="bold")
    for column in ("", "check", "found", "needed for"):
        table.add_column(column, overflow="fold")
    for finding in findings:
        table.add_row(_SIGNS[finding.state], finding.check, finding.found, finding.needed_for)
    console.print(table)
    # Below the table, where a command is one line that can be copied.
    titles = {"missing": "Missing", "weak": "Could be better", "optional": "Not asked for"}
    for state, title in titles.items():
        mends = [f for f in findings if f.state == state and f.remedy]
        if mends:
            console.print("\n", _SIGNS[state], " ", Text(title, "bold"), sep="")
        for finding in mends:
            mend = Text.assemble(f"  {finding.check}: ", (visible(finding.remedy), "cyan"))
            console.print(mend, soft_wrap=True)
    missing = [f.check for f in findings if f.state == "missing"]
    last = f"Missing: {', '.join(missing)}" if missing else "All requirements are installed."
    console.print(f"\n{last}")
