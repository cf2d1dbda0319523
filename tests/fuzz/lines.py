"""Command lines with one wrong value: every verb, every option."""

import contextlib
import os
import shutil
from collections.abc import Sequence
from contextlib import AbstractContextManager
from importlib import import_module
from pathlib import Path
from random import Random
from typing import Any
from unittest.mock import patch

from typer.main import get_command

from tests.fuzz.cases import Result, copied
from tests.fuzz.judge import Outcome, judge_verb
from tests.fuzz.nasty import NUMBERS, TEXTS
from tests.fuzz.targets import MAPPED, PANDA_RIG, TRUCK_MODELS, Target, app_of, parts_of

ACCEPTED = SystemExit(0)
"""A command line was taken; what would follow takes long, or starts servers."""


def right(line: str, **known: Any) -> Target:
    """A right command line."""
    return Target(line, line=line, **known)


LINES = {
    "init": right("init new"),
    "run": right("run sweep.yaml --dry-run"),
    "search": right("search search.yaml --dry-run"),
    "status": right("status sweep.yaml"),
    "clean": right("clean sweep.yaml", codes=(0, 1), needs="runs"),
    "doctor": right("doctor sweep.yaml", codes=(0, 1)),
    "report": right("report run", stops_at="tracking.report.build.build_report"),
    "figures": right("figures run", stops_at="tracking.report.paper_figures.write_figures"),
    "search-report": right(
        "search-report found", stops_at="tracking.search_report.build.build_search_report"
    ),
    "dashboard": right("dashboard runs/mlflow.db", stops_at="tracking.dashboard.connect"),
    "record": right("record sweep.yaml out", stops_at="sweeps.execution.runner.run_tasks"),
    "pretrain": right(
        "pretrain sweep.yaml --out base.pt", stops_at="sweeps.execution.runner.run_tasks"
    ),
    "calibrate": right(
        "calibrate sweep.yaml --out curves.json", stops_at="sweeps.calibration.observations.rigs_of"
    ),
    "calibrate --log": right(
        "calibrate --log log --rig a=found.parquet --geometry a=rig.yaml --layout parquet",
        stops_at="sweeps.evaluation.request.read_detections",
    ),
    "evaluate": right(
        "evaluate log found.parquet --layout parquet --class Car --split test --counted visible",
        stops_at="sweeps.evaluation.request.read_detections",
    ),
    "failures": right(
        "failures run --rigs center,line --where seed=1 --out out",
        stops_at="sweeps.commands.failures._compared",
    ),
    "convert table": right("convert table csv out"),
    "convert a table": right("convert table csv/boxes.csv out --frames 9"),
    "convert labels": right(f"convert table labels/labels.csv {MAPPED}"),
    "convert kitti": right("convert kitti kitti out"),
    "convert nuscenes": right("convert nuscenes nuscenes out"),
    "convert argoverse": right("convert argoverse av2 out"),
    "convert waymo": right("convert waymo waymo out"),
    "convert openlabel": right("convert openlabel openlabel out --origin 0 0 0"),
    "convert truckscenes": right(f"convert truckscenes truckscenes out {TRUCK_MODELS}"),
    "convert pandaset": right(f"convert pandaset pandaset out {PANDA_RIG}"),
    "convert opv2v": right("convert opv2v opv2v out"),
    "convert openpcdet": right("convert openpcdet openpcdet out"),
    "carla": right(
        "carla carla.yaml out --host 127.0.0.1 --port 1 --timeout 0.1",
        stops_at="lidarplace.plugins.carla.command.collect",
    ),
    "sensors": right("sensors list vlp16"),
    "sensors fit": right("sensors fit cloud.parquet --like vlp16 --out lidar.yaml"),
    "sensors import": right("sensors import makers/vlp4db.yaml --out lidar.yaml"),
    "rig": right("rig rig.yaml objects.json --format carla --lidar vlp16"),
    "read a rig": right("rig rigs/urdf.urdf new.yaml --origin 0 0 0 --only *"),
    "describe": right("describe log"),
    "view": right("view log --placement line"),
    "studio": right(
        "studio rig.yaml --log log --resolution 0.4",
        stops_at="lidarplace.studio.page.server.serving",
    ),
    "export": right("export log out --placement line"),
    "requirements": right("requirements needs.yaml", codes=(0, 1)),
}
"""By verb."""


PATHS = (
    *("", "/", "no/such/file", "x" * 300, "a\x00b", "\udcff", "/dev/null", "/dev/full"),
    *("/proc/1/mem", "[/x]", "log/boxes.parquet", "log", "sweep.yaml", "--", "s3://", "http://x y"),
    *("/dev/zero", "pipe", "loop", "nothing"),  # the last three are made for each case
)
WORDS = (*TEXTS[:14], "\x1b[31m", "no=where", "=", "a.b.c=1", "s3://x/y", "1,2", "\udcff")


def options_of(app: Any, verb: str | None) -> list[Any]:
    """Parameters of a command that take a value."""
    command = get_command(app)
    command = command.get_command(None, verb) if verb else command
    return [p for p in command.params if not getattr(p, "is_flag", False) and p.name != "help"]


def value_for(random: Random) -> str:
    """A wrong value for any parameter."""
    if random.random() < 0.5:
        return str(random.choice(NUMBERS)).removesuffix(".0")
    return random.choice((*WORDS, *PATHS))


def wrong_line(app: Any, arguments: Sequence[str], random: Random) -> tuple[list[str], str]:
    """The command line with one wrong thing, and which parameter that is."""
    words = list(arguments)
    group = hasattr(get_command(app), "commands")
    parameters = options_of(app, words[0] if group else None)
    chosen = random.choice([*parameters, None])
    if chosen is None:
        extra = random.choice(("--nope", "more", "-x", "--set", "\x00"))
        return [*words, extra], extra
    count = chosen.nargs if chosen.nargs > 1 else 1
    if chosen.param_type_name == "argument":
        positions = [i for i, word in enumerate(words) if not word.startswith("-")][group:]
        arguments_only = [p for p in parameters if p.param_type_name == "argument"]
        at = arguments_only.index(chosen)
        value = value_for(random)
        if at < len(positions):
            words[positions[at]] = value
        else:
            words.append(value)
        return words, str(chosen.metavar or chosen.name)
    name = max(chosen.opts, key=len)
    while name in words:
        at = words.index(name)
        del words[at : at + 1 + count]
    values = [value_for(random) for _ in range(1)] + ["0"] * (count - 1)
    if random.random() < 0.1:
        values = values[:-1]  # none
    return [*words, name, *values], name


def run_line(name: str, seed: int, number: int, world: Path, place: Path) -> Result:
    """One wrong command line, in the new folder `place`."""
    line = LINES[name]
    random = Random(f"{name}/{seed}/{number}")
    words, parameter = wrong_line(app_of(line.line), line.arguments, random)
    copied(world, place, parts_of(f"{line.line} {line.needs}", world))
    os.mkfifo(place / "pipe")
    (place / "loop").symlink_to("loop")
    (place / "nothing").symlink_to("gone")
    changed = [word for word in words if word not in line.arguments]
    quoted = [ascii(text[:40])[1:-1] for word in changed for text in (word, str(Path(word)))]
    quoted += [str(Path(word).parent) for word in changed if len(Path(word).parts) > 2]
    named = (parameter, parameter.upper(), *filter(None, quoted), *line.arguments, "--")
    places = (*named, "No such option", "extra argument", "null byte", "needs the package", "OUT")
    outcome = outcome_of_line(line, words, places, place)
    shutil.rmtree(place)
    printed = " ".join(repr(word)[:60] for word in words)
    return Result(name, f"{seed} {number}", printed, outcome)


def outcome_of_line(
    line: Target, words: Sequence[str], places: Sequence[str], place: Path
) -> Outcome:
    """Outcome of the verb of a line for `words` in the folder `place`."""
    stop: AbstractContextManager[object] = contextlib.nullcontext()
    if line.stops_at:
        import_module(line.stops_at.rpartition(".")[0])
        stop = patch(line.stops_at, side_effect=ACCEPTED)
    with contextlib.chdir(place), stop:
        return judge_verb(app_of(line.line), words, places, line.codes)
