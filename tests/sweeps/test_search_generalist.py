"""A search whose objective a generalist measures."""

import json

import numpy as np
import pandas as pd
import pytest
import yaml
from search_files import write_search
from small_log import write_small_log
from typer.testing import CliRunner

from sweeps.configuration.file import ConfigError
from sweeps.search.__main__ import app
from sweeps.search.problem.problem import read_problem
from sweeps.search.problem.training_rigs import training_rigs
from sweeps.search.trials import by_generalist
from tracking.run_folders.search import SearchFolder

TINY = {
    "detector": "pointpillars_tiny",
    "training": {"epochs": 1, "batch_size": 1},
    "generalist": {"rigs": 4, "rigs_per_frame": 2, "epochs": 1},
    "lidar": {"azimuth_steps": 180},
}


def written(folder, **changes):
    """A configuration with logs for the trials, the choice and the verification."""
    for name in ("trials", "choice"):
        if not (folder / name).exists():
            write_small_log(folder / name)
    traffic = {
        purpose: {"scene.test_folder": str(folder / name)}
        for purpose, name in (("search", "trials"), ("choice", "choice"))
    }
    settings = {"objective": "generalist", "traffic": traffic, "sampler": "random"}
    search = settings | {"trials": 6, "batch_size": 3} | changes.pop("search", {})
    return write_search(folder, **TINY | changes, search=search)


def run(path):
    return CliRunner().invoke(app, [str(path)], catch_exceptions=False)


@pytest.fixture(scope="module")
def tracking(tmp_path_factory):
    return {"uri": f"sqlite:///{tmp_path_factory.mktemp('mlflow') / 'mlflow.db'}"}


def test_one_training_judges_all_and_a_resumed_search_judges_nothing_again(
    tmp_path, tracking, monkeypatch
):
    def height(objective, classes, metrics):  # a tiny training finds nothing
        return float(metrics.attrs["height"])

    def metrics(store, portions, truths, classes):
        table = real(store, portions, truths, classes)
        table.attrs["height"] = 10 * portions[0].params.collection.placement.mounts[0].z
        return table

    real = by_generalist.judged_metrics
    monkeypatch.setattr(by_generalist, "judged_metrics", metrics)
    monkeypatch.setattr(by_generalist, "weighted_value", height)
    path = written(tmp_path, tracking=tracking, search={"constraints": {"distance": 0.8}})
    result = run(path)
    assert result.exit_code == 0, result.output
    store, folder = tmp_path / "runs/store", tmp_path / "runs/small"
    assert len(list(store.glob("pretrain/*"))) == 1
    assert not list(store.glob("finetune/*"))
    table = pd.read_parquet(folder / "trials.parquet")
    feasible = table[table["feasible"]]
    assert (~table["feasible"]).any()
    value = feasible["value.generalist.recall"]
    np.testing.assert_allclose(value, 10 * feasible["lidar_1.z_m"], atol=1e-9)
    judged = list(store.glob("judge/*"))
    # The first portion of all, the others of those that lead alone.
    assert len(feasible) < len(judged) < by_generalist.PORTIONS * len(feasible)
    before = {p: p.stat().st_mtime_ns for p in store.rglob("*") if p.is_file()}
    (folder / "optuna.journal").unlink()  # a search that lost its trials finds its detections
    assert run(path).exit_code == 0
    after = {p: p.stat().st_mtime_ns for p in store.rglob("*") if p.is_file()}
    results = {p: t for p, t in before.items() if p.parent != store / "sweeps"}
    assert {p: after.get(p) for p in results} == results
    again = pd.read_parquet(folder / "trials.parquet")
    pd.testing.assert_frame_equal(again.drop(columns="seconds"), table.drop(columns="seconds"))

    found = SearchFolder.read(folder)
    assert found.search.baseline is not None
    assert found.chosen is not None
    best = [rig for rig in found.search.rigs.values() if rig.role == "found"]
    assert len(best) <= 8
    assert set(found.chosen["rig"]) == set(found.search.rigs)
    text = (folder / "search.html").read_text()
    assert "On traffic that the search did not see" in text
    sweep = yaml.safe_load((folder / "sweep.yaml").read_text())
    assert "judge" not in sweep  # it is verified by detectors of its own
    assert sweep["mounting_errors"] == {"offset": 0.01, "angle_deg": 0.5}


def test_several_objectives_and_the_price_make_a_front(tmp_path, tracking):
    path = written(
        tmp_path,
        tracking=tracking,
        search={
            "lidars": [1, 2],
            "objective": ["generalist.AP_R40_BEV.Car", "price"],
            "models": {"small": {"beams": 4, "azimuth_steps": 180, "price": 2}},
            "trials": 4,
            "batch_size": 4,
        },
    )
    result = run(path)
    assert result.exit_code == 0, result.output
    about = json.loads((tmp_path / "runs/small/search.json").read_text())
    assert [o["name"] for o in about["objectives"]] == ["generalist.AP_R40_BEV.Car", "price"]


def test_training_rigs_are_of_the_space_and_of_every_number(tmp_path):
    problem = read_problem(written(tmp_path, search={"lidars": [1, 3]}))
    rigs = training_rigs(problem.space, problem.models, 9, 0)
    assert [len(rig) for rig in rigs.values()] == [1] * 3 + [2] * 3 + [3] * 3
    mounts = [choice.mount for rig in rigs.values() for choice in rig]
    assert all(-0.5 <= m.x <= 0.5 and -0.6 <= m.y <= 0.6 and 1.8 <= m.z <= 2.2 for m in mounts)
    assert any(mount.roll == 0 for mount in mounts)
    assert any(mount.roll != 0 for mount in mounts)
    assert rigs == training_rigs(problem.space, problem.models, 9, 0)
    assert rigs != training_rigs(problem.space, problem.models, 9, 1)


@pytest.mark.parametrize(
    ("search", "message"),
    [
        ({"objective": ["generalist", "recall"]}, "one judge for all of them"),
        ({"objective": "generalist.expected_ig"}, "expected_ig is not measured by a detector"),
        ({"objective": "generalist", "rungs": [{"training.epochs": 1}]}, "rungs: are shorter"),
        ({"objective": "expected_ig"}, "traffic: is for an objective that a generalist measures"),
        ({"traffic": {}}, r"search\.traffic\.search: name a log for it"),
        ({"traffic": {"search": {"scene.seed": 1}, "choice": {"roi.x": [0, 20]}}}, "allowed are"),
        ({"traffic": {"search": {"scene.seed": 1}, "choice": {"scene.seed": 1}}}, "different"),
    ],
)
def test_what_a_generalist_cannot_answer_is_refused(tmp_path, search, message):
    with pytest.raises(ConfigError, match=message):
        read_problem(written(tmp_path, search=search))


def test_simulated_traffic_is_of_other_towns_also_where_its_amount_is_told(tmp_path):
    settings = TINY | {
        "scene": {"seed": 3},
        "search": {
            "zones": {"roof": {"x": 0, "y": [-0.5, 0.5], "z": [2, 3]}},
            "objective": "generalist",
            "traffic": {"search": {"scene.test_routes": 4}},
        },
    }
    path = tmp_path / "search.yaml"
    path.write_text(yaml.safe_dump(settings))
    found = read_problem(path).traffic
    assert found.search == {"scene.test_routes": 4, "scene.test_seed": 1004}
    assert found.choice == {"scene.test_seed": 1005}


@pytest.mark.parametrize("rigs", [0, [], ["line", "line"], "line", [1], True])
def test_rigs_are_a_number_or_names(tmp_path, rigs):
    with pytest.raises(
        ConfigError, match=r"generalist\.rigs: found .*; allowed is a number from 1"
    ):
        read_problem(written(tmp_path, generalist={"rigs": rigs}))


def test_rigs_that_nobody_knows_are_told_before_the_search(tmp_path):
    with pytest.raises(ConfigError, match=r"generalist\.rigs: no placement 'nobody'"):
        read_problem(written(tmp_path, generalist={"rigs": ["nobody"]}))


def test_the_judge_of_a_search_is_named_in_its_objective(tmp_path):
    with pytest.raises(ConfigError, match="judge: is for sweeps"):
        read_problem(written(tmp_path, judge="generalist"))
