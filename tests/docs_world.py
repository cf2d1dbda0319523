"""A folder in which the commands of the docs run: files of the names that they use, all tiny."""

import os
import shutil
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import trimesh
import typer
import yaml
from typer.testing import CliRunner, Result

from lidarplace import Lidar
from sweeps.command_line import VERBS
from tests.docs_blocks import ROOT, blocks
from tests.fuzz.world import SEARCH as SMALL_SEARCH
from tests.fuzz.world import write_data_sets
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
    while hasattr(command, "commands") and arguments and arguments[0] in command.commands:
        command, arguments = command.commands[arguments[0]], arguments[1:]
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
