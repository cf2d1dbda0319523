"""Requirements of a sweep: the verdicts of `lidarplace requirements`, in tables and on pages."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from lidarplace import PAPER_PLACEMENTS
from sweeps.commands import requirements as verb
from sweeps.commands import run
from sweeps.plan.plan import read_plan
from tests.mlflow_database import write_database
from tests.sweeps.small_log import SMALL, write_sweep
from tests.sweeps.toy import call
from tracking.run_folders.sweep import RunFolder

NEEDS = [
    {"name": "people / near", "where": {"distance": [0.5, 2]}, "what": "Pedestrian", "step": 1.0}
    | {"at_least": {"points": 5}, "also_when": {"one_lidar_dead": True, "range_factor": 0.02}},
    {"name": "found", "where": {"x": [5, 9], "y": [-2, 2]}, "what": "Car", "step": 2.0}
    | {"at_least": {"probability": 0.01}, "for": 0.5},
    {"name": "ground", "where": {"distance": [0, 1], "z": [0, 1]}, "step": 0.5}
    | {"at_least": {"coverage": 0.9}},
]
SWEEP = SMALL | {
    "lidar": {"beams": 4, "azimuth_steps": 90},
    "detector": None,
    "surrogate": SMALL["surrogate"] | {"names": ["s_mig"]},
    "requirements": NEEDS,
    "vehicle": [[[-2, -1, 0], [2, 1, 1]]],
    "grid": {"placement": ["line", "center"]},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder in which the sweep has run."""
    folder = tmp_path_factory.mktemp("needs")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        write_database(Path("runs/mlflow.db"))
        done = sweep(SWEEP)
    assert "requirements" in done.stdout
    assert "of 3" in done.stdout, "a column of the summary"
    return folder


@pytest.fixture(autouse=True)
def in_folder(folder, monkeypatch):
    monkeypatch.chdir(folder)


def sweep(content, *arguments):
    path = write_sweep(Path(), "small.yaml", **content)
    return call(run.app, path, *arguments, env={"COLUMNS": "160"})


def test_a_sweep_has_the_verdicts_of_the_verb():
    table = pd.read_parquet("runs/small/requirements.parquet")
    file = {key: SWEEP[key] for key in ("lidar", "vehicle", "requirements")}
    Path("needs.yaml").write_text(yaml.safe_dump(file | {"rigs": ["line", "center"]}))
    call(verb.app, "needs.yaml", "--json", code=1)
    expected = pd.read_csv("requirements.csv")
    pd.testing.assert_frame_equal(
        table.rename(columns={"placement": "rig"}), expected, check_dtype=False, atol=1e-9
    )
    own = table[table["requirement"] == "people / near"].groupby("placement")["case"].nunique()
    lidars = {name: len(PAPER_PLACEMENTS[name].mounts) for name in own.index}
    assert own.to_dict() == {name: 2 + number for name, number in lidars.items()}


def test_the_report_folds_them_and_draws_what_fails():
    page = Path("runs/small/report.html").read_text(encoding="utf-8")
    assert '<details class="folded"><summary><h2 id="requirements">Requirements</h2>' in page
    run_folder = RunFolder.read(Path("runs/small"))
    worst = run_folder.requirements.groupby(["placement", "requirement"])["value"].min()
    failed = {
        key for key, value in worst.items() if value < {"ground": 0.9, "found": 0.01}.get(key[1], 5)
    }
    for name in ("line", "center"):
        for own in NEEDS:
            drawn = f"{name} · {own['name']}: FAIL" in page
            assert drawn == ((name, own["name"]) in failed)
            ground = run_folder.grounds.under(name, own["name"])
            if own["name"] != "ground":  # whose columns have shares, and whose value is the mean
                lowest = run_folder.requirements.query("placement == @name")
                lowest = lowest[lowest["requirement"] == own["name"]]["at_worst"].min()
                assert np.nanmin(ground.least) == pytest.approx(lowest, rel=1e-6)
    markdown = Path("runs/small/report.md").read_text(encoding="utf-8")
    assert "people / near" in markdown
    assert "requirements met" in markdown
    assert Path("runs/small/tables/requirements.csv").exists()


def test_axes_of_lidar_and_weather_have_verdicts_of_their_own():
    axes = {"lidar.range": [3.0, 60.0], "weather.visibility": [4.0, 1000.0]}
    content = SWEEP | {"requirements": NEEDS[1:2], "grid": {"placement": ["line"], **axes}}
    values = {}
    for trial in read_plan(write_sweep(Path(), "axes.yaml", **content))[1].trials:
        (value,) = trial.requirements.stage.run().table["value"]
        values[tuple(trial.grid_point.axes[axis] for axis in axes)] = value
    assert len(values) == 4
    assert values[3.0, 4.0] < values[60.0, 1000.0]
    assert values[60.0, 4.0] < values[60.0, 1000.0]


def test_a_dry_run_says_what_is_asked_and_what_is_there():
    planned = json.loads(sweep(SWEEP, "--dry-run", "--json").stdout)
    assert planned["stages"]["requirements"] == {"tasks": 2, "cached": 2}
    names = [own["requirement"] for own in planned["requirements"]]
    assert names == [own["name"] for own in NEEDS]
    assert planned["requirements"][0]["objects"] > planned["requirements"][0]["positions"] > 0
    assert "people / near" in sweep(SWEEP, "--dry-run").stdout
    changed = SWEEP | {"requirements": NEEDS[:1]}
    planned = json.loads(sweep(changed, "--dry-run", "--json").stdout)
    assert planned["stages"]["requirements"] == {"tasks": 2, "cached": 0}
    assert planned["stages"]["surrogates"] == {"tasks": 2, "cached": 2}


def test_several_sensors_and_common_view_in_a_sweep():
    """The pages have them as other requirements; a common view has no ground to draw."""
    twice = NEEDS[0] | {
        "at_least": {"points": 5, "sensors": 2}, "also_when": {"sensors_dead": 2},
    }  # fmt: skip
    view = {"name": "calibration", "common_view": {"pairs": "all", "share": 0.99}}
    sweep(SWEEP | {"name": "twice", "requirements": [twice, view]})
    run_folder = RunFolder.read(Path("runs/twice"))
    table = run_folder.requirements.set_index(["placement", "requirement", "case"]).sort_index()
    own = table.loc[("line", "people / near")]
    assert set(own["measure"]) == {"points by 2 sensors"}
    assert len(own) == 1 + 6
    shared = table.loc["line", "calibration"]
    assert len(shared) == 1
    assert shared["x"].isna().all()
    assert not shared["met"].any()
    page = Path("runs/twice/report.html").read_text(encoding="utf-8")
    assert "5 points by 2 sensors" in page
    assert "line · calibration" not in page
    assert "nan" not in Path("runs/twice/report.md").read_text(encoding="utf-8").lower()
