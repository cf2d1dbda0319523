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
        {"name": "people", "where": {"distance": [0.5, 2]}, "what": "Pedestrian"}
        | {"at_least": {"points": 1}, "step": 1.0}
    ],
}


@pytest.fixture(autouse=True)
def in_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def run(content, *arguments):
    Path("needs.yaml").write_text(yaml.safe_dump(content))
    return CliRunner().invoke(app, ["needs.yaml", *arguments], env={"COLUMNS": "160"})


def outcomes(content):
    return json.loads(run(content, "--json").stdout)["outcomes"]


def small(**changes):
    """The small file with keys of its only requirement changed; None takes one out."""
    wanted = SMALL["requirements"][0] | changes
    settings = {key: value for key, value in wanted.items() if value is not None}
    return SMALL | {"requirements": [settings]}


GROUND = ("corners", "the ground around")


def test_the_example():
    """Both rigs see pedestrians with any one LiDAR dead; neither a child right behind the car."""
    result = run(EXAMPLE, "--json")
    assert result.exit_code == 1, result.output
    outcomes = json.loads(result.stdout)["outcomes"]
    met = {(case["rig"], case["requirement"]): case["met"] for case in outcomes}
    assert {rig for rig, _ in met} == {"line", "corners"}
    assert met["line", "pedestrians all around"]
    assert met["corners", "pedestrians all around"]
    ground = next(o for o in outcomes if (o["rig"], o["requirement"]) == GROUND)
    assert ground["cases"][0]["undecided"] > 0, "by phases of the voxels"
    assert not met["line", "the ground around"]
    behind = next(case for case in outcomes if case["requirement"] == "a child behind")
    assert not behind["met"]
    assert behind["cases"][0]["short_by"] == 10
    assert -3.35 <= behind["cases"][0]["x"] <= -2.55, "close to the rear"
    table = pd.read_csv("requirements.csv")
    assert len(table) == sum(len(outcome["cases"]) for outcome in outcomes)
    for column, key in (("value", "value"), ("heading_deg", "heading_deg"), ("met", "met")):
        values = [case[key] for outcome in outcomes for case in outcome["cases"]]
        np.testing.assert_array_equal(table[column], np.array(values, table[column].dtype))
    page = Path("requirements.html").read_text(encoding="utf-8")
    assert "corners · a child behind: FAIL" in page
    assert "line · pedestrians all around: pass" in page


def test_verdicts_and_exit_codes():
    good = run(SMALL)
    assert good.exit_code == 0, good.output
    assert "pass" in good.stdout
    assert "Failed verdicts: 0 of 1. requirements.csv, requirements.html" in good.stdout
    bad = run(small(at_least={"points": 10_000}), "--out", "found/it")
    assert bad.exit_code == 1
    assert "FAIL" in bad.stdout
    assert Path("found/it.html").exists()


@pytest.mark.parametrize("name", ["vlp16", "mid70"])
def test_a_lidar_by_its_name_alone(name):
    one, other = (outcomes(SMALL | {"lidar": lidar}) for lidar in (name, {"name": name}))
    assert one == other != []


def test_a_dry_run_writes_nothing():
    result = run(SMALL, "--dry-run", "--json")
    plan = json.loads(result.stdout)
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
        target = {"class": "Pedestrian", "reflectivity": reflectivity}
        return outcomes(small(what=target) | {"lidar": lidar})[0]["cases"][0]["at_worst"]

    assert points(0.02) < points(0.9) == points(1.0)


def test_what_is_kept_out_hides_what_is_behind_it():
    """As a box of the vehicle does, with which it shares its outline."""
    wall = {"x": [1.0, 1.1], "y": [-0.9, 0.9], "z": [0.9, 2.5]}
    box = [[item[end] for item in wall.values()] for end in (0, 1)]
    body = [[[-2.35, -0.95, 0.0], [2.35, 0.95, 0.95]], [[-1.75, -0.8, 0.0], [0.9, 0.8, 1.5]]]
    front = small(where={"x": [3, 6], "y": [-1, 1]})
    keys = ({}, {"keep_out": {"window": wall}}, {"vehicle": [*body, box]})
    results = [outcomes(front | item) for item in keys]
    assert results[0] != results[1] == results[2]
    assert results[0][0]["met"]
    assert not results[1][0]["met"]


def test_overrides():
    result = run(SMALL, "--set", "lidar.beams=1", "--set", "lidar.elevation_deg=[89, 89]")
    assert result.exit_code == 1, "it looks at the sky"


def test_several_sensors_and_their_common_view():
    """Four LiDARs on the roof: any two dead, two of the others see people; a front one is apart."""
    people = SMALL["requirements"][0]
    twice = people | {"at_least": {"points": 1, "sensors": 2}, "for": 0.8}
    twice["also_when"] = {"sensors_dead": 2}
    view = {"name": "calibration", "common_view": {"pairs": "chain", "share": 0.2}}
    sky = {"x": 0.9, "z": 1.6, "pitch": -1.5, "lidar": {"beams": 4, "elevation_deg": [0, 5]}}
    roof = [{"x": x, "y": y, "z": 1.8} for x in (-0.5, 0.5) for y in (-0.4, 0.4)]
    rigs = {"roof": {"mounts": roof}, "apart": {"mounts": [*roof[:2], sky]}}
    result = run(SMALL | {"placements": rigs, "requirements": [twice, view]})
    assert result.exit_code == 1, result.output
    lines = [
        line.split() for line in result.stdout.splitlines() if "roof" in line or "apart" in line
    ]
    verdicts = {
        (words[0], words[1]): next(w for w in words if w in ("pass", "FAIL")) for words in lines
    }
    names = ("people", "calibration")
    assert [verdicts["roof", name] for name in names] == ["pass", "pass"]
    assert [verdicts["apart", name] for name in names] == ["FAIL", "FAIL"]
    assert "1 points by 2 sensors" in result.stdout
    results = outcomes(SMALL | {"placements": rigs, "requirements": [view]})
    (case,) = next(outcome["cases"] for outcome in results if outcome["rig"] == "apart")
    assert case["case"].endswith("and LiDAR 3")
    assert case["x"] is None
    assert case["value"] < 0.2
