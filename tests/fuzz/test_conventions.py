"""Conventions that are not ours are refused, or give a warning, wherever a box log comes in."""

from dataclasses import replace

import pytest
import yaml
from typer.testing import CliRunner

from lidarplace.base.errors import InputError
from lidarplace.commands.convert import app
from lidarplace.logs.box_log import write_box_log
from lidarplace.logs.boxes import POSE_COLUMNS
from lidarplace.scenes.recorded import LogScene
from tests.fuzz.conventions import CONVENTIONS, OF_TIME, WITH_POSES, right_log
from tests.lidarplace.company_table import Manner, mapping_of, write_in_manner


def convert(*arguments):
    """Message about a table, empty if there is none."""
    result = CliRunner().invoke(app, ["table", *map(str, arguments)])
    assert result.exit_code in (0, 2), result.exception
    assert result.stderr.count("\n") == 1 or result.exit_code == 0
    return result.stderr


def table(log, folder):
    write_box_log(folder / "log", log)
    return convert(folder / "log", folder / "out")


def scene(log, folder):
    write_box_log(folder / "log", log)
    try:
        return "\n".join(LogScene(source="log", folder=folder / "log").cautions())
    except InputError as error:
        return str(error)


def label_table(log, folder):
    manner = Manner(coordinates="world" if POSE_COLUMNS[0] in log.frames else "ego")
    if manner.coordinates == "ego":  # which the writer needs
        log = replace(log, frames=log.frames.assign(**dict.fromkeys(POSE_COLUMNS, 0.0)))
    write_in_manner(log, manner).to_parquet(folder / "labels.parquet")
    (folder / "map.yaml").write_text(yaml.safe_dump(mapping_of(log, manner)))
    return convert(folder / "labels.parquet", folder / "out", "--mapping", folder / "map.yaml")


DOORS = {"table": table, "scene": scene, "label table": label_table}


CASES = [
    *((name, door, poses) for name in CONVENTIONS for door in DOORS for poses in (True, False)),
    *((name, door, True) for name in OF_TIME for door in ("table", "scene")),
    *((name, door, True) for name in WITH_POSES for door in DOORS),
]


def said(door, log, poses, folder):
    """What a door says of a log with or without poses."""
    if not poses:
        log = replace(log, frames=log.frames.drop(columns=[*POSE_COLUMNS]))
    folder.mkdir()
    return DOORS[door](log, folder)


@pytest.mark.parametrize("seed", [5, *(pytest.param(n, marks=pytest.mark.long) for n in range(20))])
@pytest.mark.parametrize("door", DOORS)
def test_conventions(door, seed, tmp_path):
    right = right_log(seed)
    for poses in (True, False):
        assert not said(door, right, poses, tmp_path / str(poses))
    for n, (name, of, poses) in enumerate(CASES):
        if of == door:
            wrong = (CONVENTIONS | OF_TIME | WITH_POSES)[name](right)
            assert said(door, wrong, poses, tmp_path / str(n)), (name, poses)
