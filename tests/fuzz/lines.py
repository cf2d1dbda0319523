"""Command lines with one wrong value: every verb, every option."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from random import Random
from unittest.mock import patch

from tests.fuzz.cases import Result, copied
from tests.fuzz.judge import Outcome, judge_verb
from tests.fuzz.mutate_options import wrong_line
from tests.fuzz.targets import QUICK

ACCEPTED = SystemExit(0)
"""A command line was taken; what would follow takes long, or starts servers."""


@dataclass(frozen=True)
class Line:
    """A right command line.

    Attributes:
        module: of the verb.
        arguments: in the world.
        needs: what is copied.
        stops_at: function whose call means that the command line was taken.
        codes: exit codes that say no mistake of the input.
    """

    module: str
    arguments: tuple[str, ...]
    needs: tuple[str, ...]
    stops_at: str = ""
    codes: tuple[int, ...] = (0,)


LINES = {
    "init": Line("sweeps.commands.init", ("new",), ()),
    "run": Line("sweeps.commands.run", ("sweep.yaml", "--dry-run"), ("sweep.yaml", "log")),
    "search": Line("sweeps.commands.search", ("search.yaml", "--dry-run"), ("search.yaml", "log")),
    "status": Line("sweeps.commands.status", ("sweep.yaml",), ("sweep.yaml", "log")),
    "clean": Line(
        "sweeps.commands.clean", ("sweep.yaml",), ("sweep.yaml", "log", "runs"), codes=(0, 1)
    ),
    "doctor": Line("sweeps.commands.doctor", ("sweep.yaml",), ("sweep.yaml", "log"), codes=(0, 1)),
    "report": Line(
        "tracking.report.command", ("run",), ("run",), "tracking.report.build.build_report"
    ),
    "search-report": Line(
        "tracking.search_report.command",
        ("found",),
        ("found",),
        "tracking.search_report.build.build_search_report",
    ),
    "dashboard": Line(
        "tracking.dashboard", ("runs/mlflow.db",), ("runs",), "tracking.dashboard.connect"
    ),
    "record": Line(
        "sweeps.commands.record",
        ("sweep.yaml", "out"),
        ("sweep.yaml", "log"),
        "sweeps.execution.run_tasks.run_tasks",
    ),
    "pretrain": Line(
        "sweeps.commands.pretrain",
        ("sweep.yaml", "--out", "base.pt"),
        ("sweep.yaml", "log"),
        "sweeps.execution.run_tasks.run_tasks",
    ),
    "calibrate": Line(
        "sweeps.commands.calibrate",
        ("sweep.yaml", "--out", "curves.json"),
        ("sweep.yaml", "log"),
        "sweeps.calibration.observations.rigs_of",
    ),
    "failures": Line(
        "sweeps.commands.failures",
        ("run", "--rigs", "center,line", "--where", "seed=1", "--out", "out"),
        ("run",),
        "sweeps.commands.failures._compared",
    ),
    "convert table": Line(
        "lidarplace.commands.convert", ("table", "csv", "out"), ("csv", "classes.yaml")
    ),
    "convert a table": Line(
        "lidarplace.commands.convert", ("table", "csv/boxes.csv", "out", "--frames", "9"), ("csv",)
    ),
    "convert labels": Line(
        "lidarplace.commands.convert",
        ("table", "labels/labels.csv", "out", "--mapping", "labels/map.yaml"),
        ("labels",),
    ),
    "convert kitti": Line("lidarplace.commands.convert", ("kitti", "kitti", "out"), ("kitti",)),
    "convert nuscenes": Line(
        "lidarplace.commands.convert", ("nuscenes", "nuscenes", "out"), ("nuscenes",)
    ),
    "convert argoverse": Line("lidarplace.commands.convert", ("argoverse", "av2", "out"), ("av2",)),
    "convert waymo": Line("lidarplace.commands.convert", ("waymo", "waymo", "out"), ("waymo",)),
    "convert openlabel": Line(
        "lidarplace.commands.convert",
        ("openlabel", "openlabel", "out", "--origin", "0", "0", "0"),
        ("openlabel",),
    ),
    "carla": Line(
        "lidarplace.plugins.carla.command",
        ("carla.yaml", "out", "--host", "127.0.0.1", "--port", "1", "--timeout", "0.1"),
        ("carla.yaml",),
        "lidarplace.plugins.carla.command.collect",
    ),
    "sensors": Line("lidarplace.commands.sensors", ("list", "vlp16"), ()),
    "sensors fit": Line(
        "lidarplace.commands.sensors",
        ("fit", "cloud.parquet", "--like", "vlp16", "--out", "lidar.yaml"),
        ("cloud.parquet",),
    ),
    "rig": Line(
        "lidarplace.commands.rig",
        ("rig.yaml", "objects.json", "--format", "carla", "--lidar", "vlp16"),
        ("rig.yaml",),
    ),
    "read a rig": Line(
        "lidarplace.commands.rig",
        ("rigs/urdf.urdf", "new.yaml", "--origin", "0", "0", "0", "--only", "*"),
        ("rigs",),
    ),
    "describe": Line("lidarplace.commands.describe", ("log",), ("log",)),
    "view": Line("lidarplace.commands.view", ("log", "--placement", "line"), ("log", "rig.yaml")),
    "studio": Line(
        "lidarplace.studio.command",
        ("rig.yaml", "--log", "log", "--resolution", "0.4"),
        ("rig.yaml", "log"),
        "lidarplace.studio.page.server.serving",
    ),
    "export": Line(
        "lidarplace.commands.export", ("log", "out", "--placement", "line"), ("log", "rig.yaml")
    ),
    "requirements": Line(
        "sweeps.commands.requirements", ("needs.yaml",), ("needs.yaml",), codes=(0, 1)
    ),
    "accuracy": Line("sweeps.commands.accuracy", ("log", *QUICK), ("log", "sweep.yaml")),
    "accuracy of a table": Line(
        "sweeps.commands.accuracy",
        ("csv/boxes.csv", "--frames", "9", *QUICK),
        ("csv", "sweep.yaml", "log"),
    ),
}
"""By verb."""


def run_line(name: str, seed: int, number: int, world: Path, place: Path) -> Result:
    """One wrong command line, in the new folder `place`."""
    line = LINES[name]
    random = Random(f"{name}/{seed}/{number}")
    app = import_module(line.module).app
    words, parameter = wrong_line(app, line.arguments, random)
    copied(world, place, line.needs)
    os.mkfifo(place / "pipe")
    (place / "loop").symlink_to("loop")
    (place / "nothing").symlink_to("gone")
    changed = [word for word in words if word not in line.arguments]
    given = [ascii(text[:40])[1:-1] for word in changed for text in (word, str(Path(word)))]
    named = (parameter, parameter.upper(), *filter(None, given), *line.arguments)
    places = (*named, "No such option", "extra argument", "null byte", "is no store", "--")
    outcome = outcome_of_line(line, words, places, place)
    shutil.rmtree(place)
    shown = " ".join(repr(word)[:60] for word in words)
    return Result(name, f"{seed} {number}", shown, outcome)


def outcome_of_line(
    line: Line, words: Sequence[str], places: Sequence[str], place: Path
) -> Outcome:
    """What the verb of a line says to `words` in the folder `place`."""
    stop: AbstractContextManager[object] = contextlib.nullcontext()
    if line.stops_at:
        import_module(line.stops_at.rpartition(".")[0])
        stop = patch(line.stops_at, side_effect=ACCEPTED)
    with contextlib.chdir(place), stop:
        return judge_verb(import_module(line.module).app, words, places, line.codes)


def run_lines(
    names: Sequence[str], seed: int, count: int, world: Path, places: Path
) -> Iterator[Result]:
    """`count` wrong command lines of each verb."""
    for name in names:
        for number in range(count):
            yield run_line(name, seed, number, world, places / f"{name}-{number}")
