"""Is everything there that a sweep needs? `python -m sweeps.doctor [grid.yaml]`."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text
from typer.core import TyperCommand

from lidarplace.optional import needs
from sweeps.execution import checks
from sweeps.execution.checks import Finding
from sweeps.options import SetOption

_EPILOG = """
Examples:
  {command}
  {command} examples/grid.yaml --json

Exit codes:
  0    done
  1    something that is needed is missing
  2    the input is wrong: one line on stderr says what
  130  stopped by Ctrl-C
"""


class _Doctor(TyperCommand):
    """In the style of `lidarplace.command_line.verbs`, which needs packages that may be missing."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            print("\nStopped.", file=sys.stderr)
            raise typer.Exit(130) from None

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        formatter.write(_EPILOG.replace("{command}", ctx.command_path))


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)

_SIGNS = {
    "good": Text("✓", "green"),
    "weak": Text("!", "yellow"),
    "optional": Text("–", "dim"),
    "missing": Text("✗", "red"),
}


@dataclass(frozen=True)
class Asked:
    """What a configuration asks of the machine; the defaults without one.

    Attributes:
        path: the file.
        overrides: KEY=VALUE in place of what the file says.
        store: URL of a remote store, None for a folder.
    """

    path: Path | None = None
    overrides: tuple[str, ...] = ()
    output: Path = Path("runs")
    folder: Path = Path("runs/store")
    store: str | None = None
    tracking_uri: str = "sqlite:///runs/mlflow.db"
    ray: str = "local"
    sumo: bool = True

    @property
    def cleaned(self) -> str:
        """What `sweeps.clean` takes: the file, or the store, as it knows no overrides."""
        if self.path and not self.overrides:
            return str(self.path)
        return self.store or str(self.folder)


@app.command(cls=_Doctor)
def doctor(
    config: Annotated[
        Path | None, typer.Argument(metavar="CONFIG", help="YAML file of a sweep or a search")
    ] = None,
    set_: SetOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="print JSON for a script")] = False,
) -> None:
    """Look whether everything is there that a sweep needs, and say how to mend what is not.

    Servers are asked only if the configuration names them.
    """
    if set_ and config is None:
        from lidarplace.command_line.verbs import wrong  # needs packages that may be missing

        wrong("--set: name the configuration file too")
    try:
        findings = look(asked_of(config, set_ or []) if config else Asked())
    except ImportError as error:  # a package is missing without which no file can be read
        findings = [
            *look(Asked()),
            Finding(str(config), f"cannot be read: {error}", "this sweep", "missing", "make setup"),
        ]
    if as_json:
        print(json.dumps([asdict(finding) for finding in findings], indent=1))
    else:
        # As `lidarplace.command_line.terminal.output`, which needs them too.
        _print(Console() if sys.stdout.isatty() else Console(width=160), findings)
    if any(finding.state == "missing" for finding in findings):
        raise typer.Exit(1)


def asked_of(config: Path, overrides: Sequence[str] = ()) -> Asked:
    """What the file and `overrides` ask for. Ends the program with exit code 2 if it is wrong."""
    from lidarplace.command_line.verbs import wrong
    from lidarplace.scenes.sumo.settings import SumoScene
    from sweeps.configuration.file import ConfigError
    from sweeps.sweep_or_search import read_either

    try:
        sweep = read_either(config, overrides)
    except ConfigError as error:
        wrong(error)
    common = sweep.common
    url = common.store.url
    remote = url is not None and "://" in url
    return Asked(
        path=config,
        overrides=tuple(overrides),
        output=common.output,
        folder=Path(url) if url and not remote else common.output / "store",
        store=url if remote else None,
        tracking_uri=common.tracking_uri,
        ray=common.ray.address,
        sumo=any(isinstance(point.point.scene, SumoScene) for point in sweep.points),
    )


def look(asked: Asked) -> list[Finding]:
    """All findings, in the order in which things are needed. One check does not stop the others."""
    client = asked.ray.startswith("ray://")
    postgres = asked.tracking_uri.startswith("postgres")
    s3 = (asked.store or "").startswith("s3")
    wanted: list[tuple[str, Callable[[], Finding]]] = [
        ("Python", checks.python_version),
        ("packages", partial(checks.packages, None, "packages", "everything", True)),
        ("sweeps", partial(checks.packages, "sweeps", "sweeps", "detectors, sweeps", True)),
        ("GPU", checks.gpu),
        ("memory", checks.memory),
        ("shared memory", checks.shared_memory),
        ("Ray", partial(checks.ray, asked.ray)),
        ("SUMO", partial(checks.sumo, asked.sumo)),
        ("disk", partial(checks.disk, asked.output, "output", asked.cleaned)),
    ]
    if asked.store:
        wanted.append(("store", partial(checks.remote_store, asked.store)))
    else:
        wanted.append(("disk", partial(checks.disk, asked.folder, "store", asked.cleaned)))
    wanted.append(("MLflow", partial(checks.mlflow, asked.tracking_uri)))
    if asked.path:
        wanted.append(("scenes", partial(scenes, asked.path, asked.overrides)))
    for extra, name, needed_for, needed in (
        ("cluster", "Ray client", "ray: ray://…", client),
        ("postgres", "PostgreSQL driver", "MLflow in PostgreSQL", postgres),
        ("s3", "S3 client", "store: s3://…", s3),
        ("carla", "CARLA client", "point clouds from a CARLA server", False),
    ):
        wanted.append((name, partial(checks.packages, extra, name, needed_for, needed)))
    return [_tried(name, check) for name, check in wanted]


def scenes(config: Path, overrides: Sequence[str] = ()) -> Finding:
    """The maps, logs and checkpoints that the file names are there."""
    from sweeps.configuration.file import ConfigError
    from sweeps.plan.plan import read_plan
    from sweeps.sweep_or_search import is_search

    try:
        if is_search(config):
            from sweeps.search.problem.problem import read_problem

            problem = read_problem(config, overrides)
            return Finding("scenes", f"{problem.file.search.trials} trials", "this search")
        _, plan = read_plan(config, overrides)
    except ConfigError as error:
        text = " ".join(str(error).split())
        return Finding("scenes", text, "this sweep", "missing", f"mend {config}")
    return Finding("scenes", f"{len(plan.trials)} trials, {len(plan.tasks)} tasks", "this sweep")


def _tried(name: str, check: Callable[[], Finding]) -> Finding:
    """What the check found; its failure is a finding too."""
    try:
        return check()
    except Exception as error:
        text = " ".join(f"{type(error).__name__}: {error}".split())
        remedy = needs(error) if isinstance(error, ModuleNotFoundError) else None
        return Finding(name, text, "see the message", "missing", remedy or "make setup")


def _print(console: Console, findings: list[Finding]) -> None:
    table = Table(box=None, pad_edge=False, header_style="bold")
    for column in ("", "check", "found", "needed for"):
        table.add_column(column, overflow="fold")
    for finding in findings:
        table.add_row(
            _SIGNS[finding.state], *map(_text, (finding.check, finding.found, finding.needed_for))
        )
    console.print(table)
    # Below the table, where a command is one line that can be copied.
    for state, title in (
        ("missing", "Missing"),
        ("weak", "Could be better"),
        ("optional", "Not asked for"),
    ):
        mends = [f for f in findings if f.state == state and f.remedy]
        if mends:
            console.print("\n", _SIGNS[state], " ", Text(title, "bold"), sep="")
        for finding in mends:
            console.print(
                Text.assemble("  ", _text(finding.check), ": ", _text(finding.remedy, "cyan")),
                soft_wrap=True,
                highlight=False,
            )
    missing = [f.check for f in findings if f.state == "missing"]
    console.print(
        _text(f"\nMissing: {', '.join(missing)}" if missing else "\nAll that is needed is there."),
        highlight=False,
    )


def _text(text: str, style: str = "") -> Text:
    """Plain text; `lidarplace.command_line.terminal` needs packages that may be missing."""
    shown = (c if c.isprintable() or c == "\n" else ascii(c)[1:-1] for c in text)
    return Text("".join(shown), style)


if __name__ == "__main__":
    app()
