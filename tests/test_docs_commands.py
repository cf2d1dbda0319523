"""Commands, configurations and Python of the docs work as they stand there.

A command runs in a folder with tiny files of the names that it uses, or it is in NOT_RUN with the
reason why it cannot; then its files and options are looked up. Nothing may be in neither.
"""

import importlib.util
import os
import re
import shlex
import shutil
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import trimesh
import typer
import yaml
from typer.testing import CliRunner, Result

from lidarplace import Lidar
from lidarplace.configuration.yaml import parse_yaml
from sweeps.command_line import VERBS
from sweeps.command_line import app as lidarplace
from sweeps.plan.plan import read_plan
from sweeps.store.open import reference
from tests.docs_blocks import ROOT, Block, blocks, commands, commands_in_text
from tests.fuzz.world import SEARCH as SMALL_SEARCH
from tests.fuzz.world import write_data_sets
from tests.lidarplace.small_data_sets import (
    write_openpcdet,
    write_opv2v,
    write_pandaset,
    write_truckscenes,
)
from tests.lidarplace.test_sensors_fit import cloud_of
from tests.mlflow_database import write_database
from tests.other_simulator import write_log as write_recorded_log
from tests.sweeps.small_log import SMALL, TOWN, write_small_log

SWEEP = SMALL | {
    "scene": {"source": "log", "folder": "small"},
    "lidar": {"beams": 4, "azimuth_steps": 90},
    "training": {"epochs": 1, "batch_size": 2, "rotation": 0.1},
    "grid": {"placement": ["line", "center"], "seed": [1]},
}
"""Takes the place of grid.yaml."""

TRAFFIC = SWEEP | {"scene": TOWN | {"seed": 1, "density": 80, "pedestrians": 5, "frame_stride": 40}}
"""Takes the place of examples/grid.yaml, whose own values other tests read."""

SEARCH = SMALL_SEARCH | {"scene": SWEEP["scene"]}


LABELS, MAPPING = "examples/labels/labels.csv", "examples/labels/map.yaml"

SWEPT = ("run", "grid.yaml")
GRANTED = {
    **dict.fromkeys(("status grid", "clean grid", "runs/grid", 'names=["grid"'), SWEPT),
    "--forget": (*SWEPT, "--set", "name=old", "--set", "detector=null"),
    "runs/search": ("search", "examples/search.yaml"),
    "logs/sumo-1": ("record", "examples/grid.yaml", "logs"),
    "=base.pt": ("pretrain", "grid.yaml", "--out", "base.pt"),
    "data/kitti": ("export", "small", "data/kitti", "--placement", "line"),
    "labels/sweep.yaml": ("convert", "table", LABELS, "logs/labels", "--mapping", MAPPING),
}
"""What has run before, by a word of the command or the block."""

GENERALIST = SWEEP | {
    "generalist": {"rigs": 2, "rigs_per_frame": 1, "epochs": 1},
    "grid": {"placement": ["line", "center"], "evaluator": ["generalist", "specialist"]},
}


def app_of(verb: str) -> typer.Typer:
    """The app of a verb."""
    return import_module(VERBS[verb].module).app


def check_options(app: typer.Typer, arguments: list[str]) -> None:
    """Raises click's UsageError if there is no such subcommand or option, or one lacks a value."""
    command: Any = typer.main.get_command(app)
    while hasattr(command, "commands") and arguments:
        if (inner := command.get_command(None, arguments[0])) is None:
            break
        command, arguments = inner, arguments[1:]
    command.make_parser(command.make_context("it", [], resilient_parsing=True)).parse_args(
        list(arguments)
    )


@cache
def run(verb: str, *arguments: str) -> Result:
    """Run `lidarplace VERB …` in this process; what several pages say, once."""
    return CliRunner().invoke(app_of(verb), list(arguments), catch_exceptions=False)


def prepare(text: str) -> None:
    """Run what a command or a block takes for granted, once."""
    for word, (verb, *arguments) in GRANTED.items():
        if word in text:
            result = run(verb, *arguments)
            assert result.exit_code == 0, f"{verb} {arguments}: {result.output}"


def make_world(folder: Path) -> None:
    """Write the files."""
    os.chdir(folder)
    (folder / "examples").mkdir()
    for name, content in (
        ("grid", SWEEP),
        ("examples/grid", TRAFFIC),
        ("examples/search", SEARCH),
        ("examples/search_demo", SEARCH),
        ("examples/generalist", GENERALIST),
        ("mine", yaml.safe_load(_block("quickstart.md", "# mine.yaml"))),
    ):
        (folder / f"{name}.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    shutil.copy(ROOT / "examples/sensor_needs.yaml", folder / "examples")
    needs = yaml.safe_load((ROOT / "examples/requirements.yaml").read_text("utf-8"))
    needs["requirements"] = needs["requirements"][:1]  # which both of its rigs meet
    (folder / "examples/requirements.yaml").write_text(yaml.safe_dump(needs))
    for log in ("small", "logs/mine", "logs/b", "logs/c"):
        write_small_log(folder / log)
    write_more_frames(folder / "logs/mine")
    write_recorded_log(folder / "logs/recorded", frames=1)
    (folder / "results").mkdir()
    for rig in ("roof", "corners"):
        detections = pd.read_parquet(folder / "logs/mine/boxes.parquet").assign(score=0.5)
        detections.to_parquet(folder / f"results/{rig}.parquet")
        (folder / f"{rig}.yaml").write_text("mounts: [{z: 2}]")
    write_database(folder / "runs/mlflow.db")
    rays = pd.DataFrame({"azimuth_deg": np.arange(20_000) % 360, "elevation_deg": -10.0})
    rays.to_csv(folder / "mid360.csv", index=False)
    (folder / "clouds/sweeps").mkdir(parents=True)
    cloud_of(Lidar.even(16, (-15, 15), 400)).to_parquet(folder / "clouds/sweeps/0.parquet")
    (folder / "our_car.yaml").write_text(
        "lidars: {up_lidar: {mask: {azimuth_deg: 360, shares: [1]}}}"
    )
    trimesh.creation.box((4500, 1500, 1800)).export(folder / "body.stl")  # its y axis is up
    for name in ("examples/labels", "examples/own_detector", "examples/command_evaluator"):
        shutil.copytree(ROOT / name, folder / name)
    settings = {key: GENERALIST[key] for key in GENERALIST if key != "grid"}
    settings |= {"detector": "own_detector.nets:build", "grid": {"placement": ["line", "center"]}}
    (folder / "examples/own_detector/sweep.yaml").write_text(yaml.safe_dump(settings))
    _tables(folder)
    write_data_sets(folder / "data", "nuscenes/v1.0-mini", "av2/sensor", both=True)
    write_truckscenes(folder / "data/man-truckscenes/v1.0-mini")
    write_pandaset(folder / "data/pandaset")
    write_opv2v(folder / "data/opv2v")
    write_openpcdet(folder / "data/custom")


def write_more_frames(log: Path) -> None:
    """Ten times the test frame, each with individuals of its own, enough for a detection curve."""
    for path in (log / "boxes.parquet", log / "frames.parquet"):
        table = pd.read_parquet(path)
        last = table[table["frame"] == table["frame"].max()]
        parts = [table]
        for number in range(4, 13):
            part = last.assign(frame=number, timestamp_s=number / 10)
            if "object_id" in part:
                part = part.assign(object_id=part["object_id"] + 10 * number, x=part["x"] + 0.1)
            parts.append(part)
        pd.concat(parts).to_parquet(path)


def _block(page: str, start: str) -> str:
    return next(b.text for b in blocks("yaml") if b.page == page and b.text.startswith(start))


def _tables(folder: Path) -> None:
    boxes = pd.read_parquet(folder / "logs/mine/boxes.parquet")
    boxes.to_csv(folder / "boxes.csv", index=False)
    boxes.to_parquet(folder / "boxes.parquet")
    (folder / "car.yaml").write_text("mounts: [{name: top, z: 2.0, lidar: vlp16}]\n")
    (folder / "data/sweeps").mkdir(parents=True)
    first = boxes[boxes["frame"] == boxes["frame"].iloc[0]]
    np.save(folder / f"data/sweeps/{first['frame'].iloc[0]}.npy", first[["x", "y", "z"]])


NOT_RUN = {
    "make ": "sets up an environment; starts servers",
    "pip install ": "needs a package index",
    "git clone ": "needs the network",
    "docker ": "builds an image",
    "pre-commit install": "writes into the repository",
    ". .venv/bin/activate": "of the shell",
    "./CarlaUE4.sh ": "needs CARLA",
    "lidarplace carla ": "needs a CARLA server",
    "cd /shared/sweeps ": "needs several machines",
    "(umask 077; ": "needs several machines",
    "export RAY_AUTH_MODE": "needs several machines",
    "ray start ": "needs several machines",
    "ray stop": "would end other people's Ray",
    "lidarplace run grid.yaml --set ray=10.0.0.1:6379": "needs several machines",
    "sbatch ": "needs Slurm",
    "python -m mlflow server ": "needs PostgreSQL",
    "lidarplace dashboard": "a server; tests/tracking/test_dashboard.py starts it",
    "lidarplace validate ": "needs real points; tests/lidarplace/validation runs it",
    "lidarplace studio": "a server; tests/lidarplace/studio/test_page.py starts it",
    "python -m pytest": "would test within a test",
    "pytest ": "would test within a test",
    "python benchmarks/": "takes minutes, and an idle machine",
    "lidarplace run grid.yaml --set training.checkpoint=pv_rcnn_8369.pth": "not at hand",
    "lidarplace cheapest examples/cheapest.yaml": "a minute; see test_cheapest.py",
    "lidarplace run grid.yaml --set evaluator=pretrained": "see tests/sweeps/test_pretrained.py",
    "lidarplace pretrain studies/pretrained/": "takes hours",
    "lidarplace run sweep.yaml --set training.mixed_precision": "a sweep of one's own",
    "lidarplace search studies/proof/search.yaml": "takes 20 minutes",
    "python studies/proof/contrast.py": "reads the runs of the proof",
    "uv pip install ": "installs for a minute",
    "lidarplace --install-completion": "changes the shell's own files",
    "lidarplace --show-completion": "depends on the shell",
}
"""How commands begin that are only looked up, and why."""

SMALLER = {
    "init": "begin",
    "pretrain": "--set training.epochs=1",
    "export": "--roi 0 20 -10 10 0 4",
    "examples/labels/sweep.yaml": "--set ray=debug --set detector=null --set grid.seed=[1] "
    "--set lidar.cloud_share=0.02 --set surrogate.resolution=0.8",
    "examples/command_evaluator/sweep.yaml": "--set ray=debug --set lidar.cloud_share=0.05 "
    "--set scene.routes=1 --set scene.test_routes=1 --set scene.frames_per_route=4 "
    "--set scene.pedestrians=5 --set scene.warmup_s=5 --set surrogate.resolution=0.8",
    "mine.yaml": "--set ray=debug --set lidar.azimuth_steps=90 --set lidar.beams=4 "
    "--set scene.routes=2 --set scene.test_routes=1 --set scene.frame_stride=40 "
    "--set scene.pedestrians=5 --set scene.frames_per_route=4 --set scene.warmup_s=5 "
    "--set surrogate.resolution=0.8 --set surrogate.accuracy=false "
    "--set surrogate.sampling_error=false --set training.epochs=1 --set grid.seed=[1] "
    "--set grid.placement=[line,mine]",
}
"""What makes a command cheap, by its verb or by its configuration."""

PLACEHOLDERS = {"runs/NAME": "runs/search", "LOG": "small", "data/argoverse2": "data/av2/sensor"}


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    pytest.importorskip("sumolib")
    folder = tmp_path_factory.mktemp("docs")
    before = Path.cwd()
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        make_world(folder)
        yield folder
        patch.chdir(before)


def listed(command: str) -> str | None:
    """Start of the command in NOT_RUN, if any; variables before it do not count."""
    bare = re.sub(r"^([A-Z_]+=\S* )+", "", command).removeprefix(".venv/bin/")
    return next((start for start in NOT_RUN if bare == start or bare.startswith(start)), None)


FIRST = {
    "README.md",
    "data.md",
    "label_files.md",
    "data_sets.md",
    "further_data_sets.md",
    "traffic.md",
    "rigs.md",
}
"""Pages whose commands run in every test; the others repeat these with other settings."""
RUN = [
    pytest.param(command, id=str(command), marks=() if command.page in FIRST else pytest.mark.long)
    for command in commands()
    if listed(command.text) is None
]
PYTHON = blocks("python")
LOOKED_UP = [c for c in commands() if listed(c.text)] + commands_in_text()


@pytest.mark.parametrize("command", RUN)
def test_runs(command, world):
    if ".mcap" in command.text:
        pytest.importorskip("foxglove")
    words = shlex.split(command.text)
    program, verb, *arguments = words
    assert program == "lidarplace", f"{command.text}: neither runs nor is listed"
    arguments = [PLACEHOLDERS.get(argument, argument) for argument in arguments]
    prepare(" ".join([verb, *arguments]))
    if "--forget" in arguments:  # the name ends in a hash of the output folder
        sweep, _ = read_plan(world / "grid.yaml", ["name=old"])
        arguments[-1] = reference(sweep)
    for name in (verb, *arguments[:1]):
        if not (name == "mine.yaml" and verb != "run"):
            arguments += SMALLER.get(name, "").split()
    result = run(verb, *arguments)
    assert result.exit_code == 0, result.output


@pytest.mark.parametrize("command", LOOKED_UP, ids=str)
def test_what_it_names_is_there(command):
    """Programs and options of what cannot run here, and of commands in the text."""
    if "…" in command.text:
        pytest.skip("a pattern of commands, not one")
    words = shlex.split(re.sub(r"^([A-Z_]+=\S* )+", "", command.text))
    program = words[:3] if words[1:2] == ["-m"] else words[:2]
    if words[0] == "make":
        for target in re.findall(r"make (\w+)", command.text):
            assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(), re.M), target
    elif program[-1] == "pytest" or words[0] == "pytest":
        look_up_tests(words[words.index("pytest") + 1 :])
    elif words[0].endswith("python") and program[1] == "-m":
        assert importlib.util.find_spec(program[2].split(".")[0]), program[2]
    elif words[0].endswith("python") and program[1] != "-c":
        script = (ROOT / program[1]).read_text(encoding="utf-8")
        for option in (word for word in words[2:] if word.startswith("--")):
            name = option[2:].partition("=")[0]
            assert option in script or name.replace("-", "_") in script, option
    elif words[0] == "lidarplace" and words[1].startswith("-"):
        check_options(lidarplace, words[1:])
    elif words[0] == "lidarplace":
        assert words[1] in VERBS
        check_options(app_of(words[1]), words[2:])


def look_up_tests(words: list[str]) -> None:
    """Files, and words of -k, which have to occur in them."""
    chosen = [ROOT / word.partition("::")[0] for word in words if word.startswith("tests")]
    assert all(path.exists() for path in chosen), words
    if "-k" in words:
        files = [file for path in chosen for file in ([path], path.rglob("*.py"))[path.is_dir()]]
        text = "\n".join(f"{file}\n{file.read_text(encoding='utf-8')}" for file in files)
        for word in re.findall(r"\w+", words[words.index("-k") + 1]):
            assert word in ("and", "or", "not") or word in text, f"-k {word} selects nothing"


def test_every_reason_is_needed():
    used = {listed(command.text) for command in commands()}
    assert set(NOT_RUN) - used == set(), "no command begins like that"


def alternatives(text: str) -> list[str]:
    """The configurations of a block: a key that occurs twice shows two ways to write it."""
    entries = re.findall(r"^\S.*\n(?:(?:[ #].*)?\n)*", text, re.M)
    keys = [entry.partition(":")[0] for entry in entries]
    if len(set(keys)) < len(keys):
        once = [entry for entry, key in zip(entries, keys, strict=True) if keys.count(key) == 1]
        several = [e for e, key in zip(entries, keys, strict=True) if keys.count(key) > 1]
        return ["".join([*once, entry]) for entry in several]
    if len(entries) == 1 and "\n  " in text and not text.startswith("#"):
        head, _, rest = text.partition("\n")
        inner = "\n".join(line.removeprefix("  ") for line in rest.splitlines()) + "\n"
        if re.search(r"^\w+:", inner, re.M):
            indented = [re.sub(r"^(?=.)", "  ", part, flags=re.M) for part in alternatives(inner)]
            return [f"{head}\n{part}" for part in indented]
    return [text]


def of_kind(block: Block) -> str:
    keys = set(re.findall(r"^([\w.]+):", block.text, re.M))
    if block.page == "carla.md":
        return "collection"
    if "requirements" in keys and "grid" not in keys:
        return "requirements"
    if "columns" in keys:
        return "mapping"
    if "factor" in keys:
        return "correction"
    if keys & {"search", "robustness", "verify"}:
        return "search"
    return "class map" if any(key.startswith("vehicle.") for key in keys) else "sweep"


@pytest.mark.parametrize("block", blocks("yaml"), ids=str)
def test_configurations(block, world):
    for number, text in enumerate(alternatives(block.text)):
        assert "…" not in re.sub(r"#.*|://…", "", text), "a value is left out"
        content = parse_yaml(text.replace("://…", "://host/db"))
        path = world / f"block-{block.page}-{block.number}-{number}.yaml"
        check(of_kind(block), content, path)


def check(kind: str, content: dict, path: Path) -> None:
    """Raises an error that names the key if the content is not a file of that kind."""
    import yaml

    from lidarplace.configuration.correction import read_correction
    from lidarplace.plugins.carla.command import Collection
    from lidarplace.scenes.datasets.class_maps import named_class_map
    from lidarplace.scenes.label_tables.mapping import read_mapping
    from sweeps.configuration.grid import read_sweep
    from sweeps.configuration.requirements_file import read_requirements_check
    from sweeps.search.problem.problem import read_problem

    if kind == "requirements":
        path.write_text(yaml.safe_dump(content, sort_keys=False))
        read_requirements_check(path)
        return
    if kind == "collection":
        Collection.model_validate(content)
        return
    if kind == "search":
        base = {"search": {"zones": {"roof": {"x": 0, "y": [-1, 1], "z": 1.8}}}}
        content = base | content
        content["search"] = base["search"] | content["search"]
    elif kind == "sweep":
        axis = {} if "grid" in content and "placement" in content["grid"] else {"placement": "line"}
        content = axis | content
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    readers = {
        "search": read_problem,
        "sweep": read_sweep,
        "class map": lambda path: named_class_map(str(path)),
        "mapping": read_mapping,
        "correction": read_correction,
    }
    readers[kind](path)


TRAINED = pytest.mark.long  # the block reads what two sweeps have logged


@pytest.mark.parametrize(
    "block",
    [pytest.param(b, id=str(b), marks=TRAINED if "names=[" in b.text else ()) for b in PYTHON],
)
def test_python(block, world, monkeypatch):
    prepare(block.text)
    exec(block.text, {})


def test_alternatives():
    assert alternatives("a: 1\na: 2\nb: 3\n") == ["b: 3\na: 1\n", "b: 3\na: 2\n"]
    assert alternatives("s:\n  o: 1\n  o: 2\n") == ["s:\n  o: 1\n", "s:\n  o: 2\n"]
    assert alternatives("s:\n  o: 1\n  p: 2\n") == ["s:\n  o: 1\n  p: 2\n"]
