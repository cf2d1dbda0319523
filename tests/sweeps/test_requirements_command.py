"""`lidarplace requirements`: what it prints and writes, and one line for a mistake."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from typer.testing import CliRunner

from sweeps.commands.requirements import app

ROOT = Path(__file__).parents[2]
EXAMPLE = yaml.safe_load((ROOT / "examples/requirements.yaml").read_text(encoding="utf-8"))
SMALL = {
    "lidar": {"beams": 4, "azimuth_steps": 90},
    "placements": {"mine": {"mounts": [{"z": 1.8}, {"x": 0.5, "z": 1.8}]}},
    "requirements": [
        {
            "name": "people",
            "where": {"distance": [0.5, 2]},
            "what": "Pedestrian",
            "at_least": {"points": 1},
            "step": 1.0,
        }
    ],
}


@pytest.fixture(autouse=True)
def in_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def run(content, *arguments):
    Path("needs.yaml").write_text(yaml.safe_dump(content))
    return CliRunner().invoke(app, ["needs.yaml", *arguments], env={"COLUMNS": "160"})


def small(**changes):
    """The small file with keys of its only requirement changed; None takes one out."""
    wanted = SMALL["requirements"][0] | changes
    kept = {key: value for key, value in wanted.items() if value is not None}
    return SMALL | {"requirements": [kept]}


def test_the_example():
    """Both rigs see pedestrians with any one LiDAR dead; neither a child right behind the car."""
    done = run(EXAMPLE, "--json")
    assert done.exit_code == 1, done.output
    found = json.loads(done.stdout)
    met = {(own["rig"], own["requirement"]): own["met"] for own in found["outcomes"]}
    assert {rig for rig, _ in met} == {"line", "corners"}
    assert met["line", "pedestrians all around"]
    assert met["corners", "pedestrians all around"]
    assert met["corners", "the ground around"]
    assert not met["line", "the ground around"]
    behind = next(own for own in found["outcomes"] if own["requirement"] == "a child behind")
    assert not behind["met"]
    assert behind["cases"][0]["short_by"] == 10
    assert -3.35 <= behind["cases"][0]["x"] <= -2.55, "close to the rear"
    table = pd.read_csv("requirements.csv")
    assert len(table) == sum(len(own["cases"]) for own in found["outcomes"])
    for column, key in (("value", "value"), ("heading_deg", "heading_deg"), ("met", "met")):
        told = [case[key] for own in found["outcomes"] for case in own["cases"]]
        np.testing.assert_array_equal(table[column], np.array(told, table[column].dtype))
    page = Path("requirements.html").read_text(encoding="utf-8")
    assert "corners · a child behind: FAILED" in page
    assert "line · pedestrians all around: met" in page


def test_verdicts_and_exit_codes():
    good = run(SMALL)
    assert good.exit_code == 0, good.output
    assert "pass" in good.stdout
    assert "0 of 1 fail; requirements.csv, requirements.html" in good.stdout
    bad = run(small(at_least={"points": 10_000}), "--out", "found/it")
    assert bad.exit_code == 1
    assert "FAIL" in bad.stdout
    assert Path("found/it.html").exists()


@pytest.mark.parametrize("name", ["vlp16", "mid70"])
def test_a_lidar_by_its_name_alone(name):
    values = []
    for lidar in (name, {"name": name}):
        done = run(SMALL | {"lidar": lidar}, "--json")
        assert done.exit_code in (0, 1), done.output
        values.append(json.loads(done.stdout)["outcomes"])
    assert values[0] == values[1]


def test_a_dry_run_writes_nothing():
    done = run(SMALL, "--dry-run", "--json")
    plan = json.loads(done.stdout)
    assert plan["rigs"] == ["mine"]
    (row,) = plan["requirements"]
    assert row["objects"] == 4 * row["positions"] > 0
    assert list(Path().iterdir()) == [Path("needs.yaml")]
    assert "people" in run(SMALL, "--dry-run").stdout


def test_rigs_by_name_file_and_run_folder():
    rig = {"mounts": [{"z": 2.0}]}
    Path("runs/found").mkdir(parents=True)
    for path in ("runs/found/placement.yaml", "mine.yaml"):
        Path(path).write_text(yaml.safe_dump(rig))
    names = ["mine", "center", "runs/found", "mine.yaml"]
    plan = json.loads(run(SMALL | {"rigs": names}, "--dry-run", "--json").stdout)
    assert plan["rigs"] == names
    papers = {key: value for key, value in SMALL.items() if key != "placements"}
    assert len(json.loads(run(papers, "--dry-run", "--json").stdout)["rigs"]) == 8


def test_the_dark_are_seen_less():
    def points(reflectivity):
        lidar = SMALL["lidar"] | {"range_10": 3.0}
        what = {"class": "Pedestrian", "reflectivity": reflectivity}
        done = run(small(what=what) | {"lidar": lidar}, "--json")
        return json.loads(done.stdout)["outcomes"][0]["cases"][0]["at_worst"]

    assert points(0.02) < points(0.9) == points(1.0)


def test_what_is_kept_out_hides_what_is_behind_it():
    """As a box of the vehicle does, with which it shares its outline."""
    wall = {"x": [1.0, 1.1], "y": [-0.9, 0.9], "z": [0.9, 2.5]}
    box = [[own[end] for own in wall.values()] for end in (0, 1)]
    body = [[[-2.35, -0.95, 0.0], [2.35, 0.95, 0.95]], [[-1.75, -0.8, 0.0], [0.9, 0.8, 1.5]]]
    front = small(where={"x": [3, 6], "y": [-1, 1]})
    found = []
    for keys in ({}, {"keep_out": {"window": wall}}, {"vehicle": [*body, box]}):
        found.append(json.loads(run(front | keys, "--json").stdout)["outcomes"])
    assert found[0] != found[1] == found[2]
    assert found[0][0]["met"]
    assert not found[1][0]["met"]


def test_overrides():
    done = run(SMALL, "--set", "lidar.beams=1", "--set", "lidar.elevation_deg=[89, 89]")
    assert done.exit_code == 1, "it looks at the sky"


WRONG = {
    "centimetres": (
        small(what={"class": "child", "height": 80}),
        "requirements[0].what.height: found 80; should be less than or equal to 50",
    ),
    "a LiDAR where none may sit": (
        SMALL | {"keep_out": {"hatch": {"x": [0.4, 0.6], "y": [-1, 1], "z": [1.7, 1.9]}}},
        "'mine': LiDAR 2 at (0.5, 0, 1.8) is inside keep_out.hatch",
    ),
    "keep-out without volume": (
        SMALL | {"keep_out": {"hatch": {"x": [0, 0], "y": [-1, 1], "z": [1.7, 1.9]}}},
        "keep_out.hatch: allowed is [min, max] with min < max along x, y and z",
    ),
    "no requirement": (SMALL | {"requirements": []}, "requirements: "),
    "zone inside the vehicle": (
        small(where={"x": [-1, 1], "y": [-0.2, 0.2]}),
        "requirements[0] 'people': where: lies inside the vehicle",
    ),
    "empty zone": (
        small(where={"distance": [0, 1], "x": [20, 30]}),
        "requirements[0] 'people': where: is empty",
    ),
    "zone without end": (small(where={"sectors": ["front"]}), "where: has no end"),
    "unknown class": (small(what="Dog"), "requirements[0].what.class: found 'Dog'"),
    "half a size": (small(what={"length": 1.0}), "what: name a class, or width, height, too"),
    "light without a range for it": (
        small(what={"class": "child", "reflectivity": 0.3}),
        "'people': what.reflectivity: LiDAR 1 of 'mine': has no range_10",
    ),
    "no range left": (
        small(also_when={"range_factor": 0.01}) | {"lidar": SMALL["lidar"] | {"min_range": 2}},
        "'people': also_when: LiDAR 1 of 'mine': min_range must be within [0, range)",
    ),
    "nothing to place": (small(what=None), "what: is missing"),
    "zero step": (small(step=0), "requirements[0].step: found 0"),
    "tiny step": (small(step=1e-5), "step: 1e-05 m makes"),
    "share over 1": (small(**{"for": 1.5}), "requirements[0].for: found 1.5"),
    "two measures": (
        small(at_least={"points": 1, "cells": 1}),
        "at_least: name one of points, cells, probability and coverage",
    ),
    "no measure": (small(at_least={}), "at_least: name one of"),
    "coverage of an object": (small(at_least={"coverage": 0.5}), "take out what and for"),
    "heights of an object": (small(where={"distance": [0, 1], "z": [0, 1]}), "where.z: is of"),
    "no curve": (
        small(at_least={"probability": 0.5, "iou": 0.6}),
        "no detection curve of Pedestrian at IoU 0.6",
    ),
    "a size without a curve": (
        small(at_least={"probability": 0.5}, what={"length": 1, "width": 1.0, "height": 1.0}),
        "what: a probability needs a class",
    ),
    "unknown preset": (small(where="un_r79"), "requirements[0].where.preset: found 'un_r79'"),
    "a preset and more": (
        small(where={"preset": "un_r158", "distance": [0, 1]}),
        "where: preset: stands alone; take out distance",
    ),
    "unknown sector": (
        small(where={"distance": [0, 1], "sectors": ["back"]}),
        "where.sectors[0]: found 'back'; allowed are front, front left",
    ),
    "lanes and y": (small(where={"lanes": ["own"], "y": [0, 1]}), "where: lanes: stand in place"),
    "a distance the wrong way round": (
        small(where={"distance": [5, 1]}),
        "where.distance: found [5, 1]; allowed is [min, max]",
    ),
    "a name twice": (SMALL | {"requirements": 2 * SMALL["requirements"]}, "requirements: found"),
    "an unknown key": (
        small(weather="rain"),
        "requirements[0].weather: unknown key (did you mean where?); allowed are name, where,",
    ),
    "mounts that are not off": (
        small(also_when={"mounts_off": {"draws": 3}}),
        "also_when.mounts_off: name offset or angle_deg",
    ),
    "an unknown rig": (SMALL | {"rigs": ["nobody"]}, "rigs: no placement 'nobody'; allowed are"),
    "a rig twice": (SMALL | {"rigs": ["mine", "mine"]}, "rigs: each once, found mine, mine"),
    "a rig of the paper's name": (
        SMALL | {"placements": {"line": {"mounts": [{"z": 2.0}]}}},
        "placements: 'line' is the paper's",
    ),
    "no such rig file": (SMALL | {"rigs": ["none.yaml"]}, "none.yaml: No such file"),
    "a mount in the body": (
        SMALL | {"placements": {"mine": {"mounts": [{"z": 1.0}]}}},
        "'mine': LiDAR 1 at (0, 0, 1) is inside the vehicle's body",
    ),
    "a body the wrong way round": (
        SMALL | {"vehicle": [[[1, 0, 0], [0, 1, 1]]]},
        "vehicle 'vehicle': box 0 needs finite corners, the lower one first",
    ),
    "too many headings": (
        small(what={"class": "child", "headings": 360}, step=0.04),
        "headings at",
    ),
    "a preset without a body": (
        small(where="un_r158") | {"vehicle": []},
        "where.preset: un_r158 lies around the vehicle's body",
    ),
}


@pytest.mark.parametrize("mistake", WRONG)
def test_a_mistake_is_one_line(mistake):
    content, message = WRONG[mistake]
    done = run(content)
    assert done.exit_code == 2, done.output
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1
    assert message in done.stderr
    named = "none.yaml" if mistake == "no such rig file" else "needs.yaml"
    assert named in done.stderr
