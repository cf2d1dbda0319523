"""A whole search through the command line, on a small log."""

import json
import time
from pathlib import Path

import optuna
import pandas as pd
import pytest
import yaml
from search_files import write_search
from typer.testing import CliRunner
from written_tables import check_columns

from lidarplace import OccupancyGrid, Placement, Roi, evaluate
from lidarplace.configuration.placement import read_placement
from lidarplace.logs.box_log import read_box_log
from sweeps.commands.search import app
from sweeps.configuration.grid import read_sweep
from sweeps.search.problem.problem import read_problem
from sweeps.search.trials.study import journal_path
from tests.forked import GUARD_S, Forked
from tests.mlflow_database import write_database
from tracking.mlflow.connection import connect
from tracking.mlflow.page import VIEW_TAG
from tracking.run_folders.search_json import SearchResult
from tracking.run_folders.search_tables import BOUND, GREEDY, ROBUSTNESS

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def tracking(tmp_path_factory):
    """One database for all searches."""
    path = tmp_path_factory.mktemp("mlflow") / "mlflow.db"
    write_database(path)
    return f"sqlite:///{path}"


def search(folder, tracking, *options, **changes):
    path = write_search(folder, tracking={"uri": tracking}, **changes)
    return CliRunner().invoke(app, [str(path), *options], catch_exceptions=False)


def about(folder):
    return json.loads((folder / "runs/small/search.json").read_text())


def trials(folder):
    return pd.read_parquet(folder / "runs/small/trials.parquet")


@pytest.fixture(scope="module")
def folder(tmp_path_factory, tracking):
    folder = tmp_path_factory.mktemp("search")
    result = search(folder, tracking)
    assert result.exit_code == 0, result.output
    return folder


def test_the_best_trial_is_what_the_files_say(folder):
    table, found = trials(folder), about(folder)
    assert len(table) == 12
    best = table[table["feasible"]]["value.expected_ig"].max()
    own = found["rigs"][found["best"][0]]
    assert own["values"]["expected_ig"] == pytest.approx(best, rel=1e-12)  # all rays in both
    bound = found["bound"]
    assert bound["greedy"] <= bound["value"] <= bound["by_gains"]
    assert bound["gap_percent"] == pytest.approx(100 * (1 - best / bound["value"]))


def test_tables_have_the_columns_that_their_models_tell(folder):
    search = SearchResult.read(folder / "runs/small")
    for table in (search.trials_table, BOUND, GREEDY, ROBUSTNESS):
        check_columns(pd.read_parquet(folder / "runs/small" / table.file), table)


def test_the_value_is_that_of_the_library(folder):
    """The placement file and the log alone give the value again."""
    problem = read_problem(folder / "small.yaml")
    log = read_box_log(folder / "log")
    train = log.frames[log.frames["split"] == "train"]
    boxes = log.boxes[log.boxes["frame"].isin(train["frame"])]
    roi = Roi((0, 40), (-20, 20), (0, 4), 0.8)
    grid = OccupancyGrid.from_boxes(boxes, roi, "Car", frames=len(train))
    lidar = problem.file.lidar.lidar()
    rig = read_placement(folder / "runs/small/placement.yaml", lidar)
    assert isinstance(rig, Placement)
    value = evaluate(grid, rig, surrogates=["expected_ig"]).expected_ig
    own = about(folder)["rigs"]["found_1"]["values"]["expected_ig"]
    assert value == pytest.approx(own, rel=1e-9)


def test_a_sweep_takes_the_result_as_it_is(folder):
    sweep = read_sweep(folder / "runs/small/sweep.yaml")
    names = [point.point.placement for point in sweep.points]
    assert names[:3] == ["found_1", "found_2", "found_3"]
    assert len(set(names)) == 3 + 8


def test_the_first_trial_is_greedys_rig_refined(folder):
    table, found = trials(folder), about(folder)
    refined = found["rigs"]["refined"]["values"]["expected_ig"]
    assert table.loc[0, "value.expected_ig"] == pytest.approx(refined, rel=1e-9)
    assert refined >= found["bound"]["greedy"] * (1 - 1e-9)


def test_mlflow_has_a_run_for_every_trial(folder, tracking):
    client = connect(tracking)
    experiment = client.get_experiment_by_name("small")
    runs = client.search_runs([experiment.experiment_id], max_results=100)
    names = {run.data.tags["mlflow.runName"] for run in runs}
    assert names >= {f"trial {n}" for n in range(12)}
    one = next(run for run in runs if run.data.tags["mlflow.runName"] == "trial 3")
    value = trials(folder).loc[3, "value.expected_ig"]
    assert one.data.metrics["expected_ig"] == pytest.approx(value)
    assert one.data.params["lidar_1.model"] == "lidar"
    assert one.data.tags["lidarplace.version"]
    assert experiment.tags["mlflow.note.content"].startswith("A search")
    view = json.loads(experiment.tags[VIEW_TAG])
    assert view["selectedColumns"][:2] == ["metrics.`expected_ig`", "metrics.`feasible`"]
    assert view["orderByAsc"] is False
    parent = next(run for run in runs if run.data.tags["mlflow.runName"] == "small")
    assert "trials: 12" in parent.data.tags["mlflow.note.content"]
    assert about(folder)["tracking_uri"] == tracking


def test_robustness_has_a_row_a_case(folder):
    table = pd.read_parquet(folder / "runs/small/robustness.parquet")
    own = table[table["rig"] == "found_1"].set_index("case")
    assert list(own.index) == ["as designed", "mounts off", "LiDAR 1 fails", "LiDAR 2 fails"]
    assert own.loc["as designed", "share"] == 1
    assert own.loc["mounts off", "draws"] == 3
    assert (own.loc[["LiDAR 1 fails", "LiDAR 2 fails"], "share"] < 1).all()


def test_a_search_begins_with_the_rig_that_one_has(tmp_path, tracking):
    mounts = [{"x": 0.1, "y": 0.2, "z": 2.0, "roll": 0.1}, {"x": -0.3, "z": 1.9}]
    options = {"start": ["mine"], "greedy": {"position_step": 0.5, "warm_start": False}}
    own = {"mine": {"mounts": mounts}}
    result = search(tmp_path, tracking, placements=own, search=options | {"trials": 4})
    assert result.exit_code == 0, result.output
    told = result.stdout.splitlines()
    begins = told.index("greedy choice, then its upper bound, up to 30 s more …")
    assert told[begins + 1].startswith("greedy choice from "), "before a minute of silence"
    first = trials(tmp_path).loc[0]
    found = {(first[f"lidar_{i}.x_m"], first[f"lidar_{i}.y_m"]) for i in (1, 2)}
    assert found == {(0.1, 0.2), (-0.3, 0.0)}
    refined = about(tmp_path)["rigs"]["refined"]["values"]["expected_ig"]
    assert refined >= first["value.expected_ig"]


def test_more_trials_go_on_where_it_stopped(folder, tracking):
    before = trials(folder)
    result = search(folder, tracking, "--set", "search.trials=16")
    assert result.exit_code == 0, result.output
    after = trials(folder)
    pd.testing.assert_frame_equal(after.iloc[:12], before)
    assert len(after) == 16


def test_s_mig_comes_with_a_warning(tmp_path, tracking):
    result = search(tmp_path, tracking, "--dry-run", search={"objective": "s_mig"})
    assert result.exit_code == 0
    assert "highest for a placement that sees nothing" in " ".join(result.output.split())


def test_no_feasible_placement(tmp_path, tracking):
    limits = {"distance": 5.0, "body_share": 0.9}
    result = search(tmp_path, tracking, search={"constraints": limits, "greedy": None})
    assert result.exit_code == 1
    assert "No rig keeps all constraints" in result.output
    found = trials(tmp_path)
    least = found["violation.distance"].min()
    never = f"No trial at all kept distance, which the best of them broke by {least:.4g} m."
    assert never in result.output
    assert (tmp_path / "runs/small/search.html").exists()


def test_nothing_of_an_earlier_search_stays(tmp_path, tracking):
    assert search(tmp_path, tracking, search={"trials": 4}).exit_code == 0
    run = tmp_path / "runs/small"
    (run / "verified.parquet").touch()
    limits = {"distance": 5.0}
    result = search(tmp_path, tracking, search={"constraints": limits, "greedy": None, "trials": 4})
    assert result.exit_code == 1
    left = {path.name for path in run.iterdir()}
    assert {"search.json", "trials.parquet", "config.yaml", "optuna.journal"} <= left
    assert not left & {
        *("placement.yaml", "sweep.yaml", "maps.npz", "bound.parquet", "greedy.parquet"),
        *("robustness.parquet", "verified.parquet"),
    }


def test_two_lidars_in_one_place(tmp_path, tracking):
    point = {"point": {"x": 0, "y": 0, "z": 2}}
    options = {"zones": point, "roll_deg": 0, "constraints": {"distance": 0}, "greedy": None}
    result = search(tmp_path, tracking, search=options | {"trials": 4})
    assert result.exit_code == 1
    assert "All 4 trials put two LiDARs in one place." in result.output


def test_an_objective_that_is_undefined(tmp_path, tracking):
    away = {"away": {"x": [-100, -99], "y": [-0.6, 0.6], "z": [1, 2]}}
    options = {"objective": "m_sog", "zones": away, "trials": 2, "batch_size": 2}
    short = {"beams": 4, "azimuth_steps": 90, "range": 50}
    result = search(tmp_path, tracking, search=options, lidar=short)
    assert result.exit_code == 1
    assert "trial 0 failed: an objective is undefined" in result.output
    assert (trials(tmp_path)["state"] == "FAIL").all()


def test_classes_that_do_not_occur(tmp_path, tracking):
    result = search(tmp_path, tracking, classes=["Car", "Pedestrian"], search={"trials": 4})
    assert result.exit_code == 0, result.output


def test_a_space_without_any_freedom_is_evaluated_once(tmp_path, tracking):
    point = {"point": {"x": 0.2, "y": 0.1, "z": 2}}
    result = search(
        tmp_path, tracking, search={"lidars": 1, "zones": point, "roll_deg": 3, "trials": 6}
    )
    assert result.exit_code == 0, result.output
    found = about(tmp_path)
    assert (found["trials"], found["evaluations"]) == (6, 1)
    assert trials(tmp_path)["value.expected_ig"].nunique() == 1
    assert found["bound"]["gap_percent"] == pytest.approx(0, abs=1e-3)


def test_twelve_lidars_and_an_objective_that_is_constant(tmp_path, tracking):
    away = {"away": {"x": [-100, -99], "y": [-0.6, 0.6], "z": [1, 2]}}  # sees nothing of the ROI
    short = {"beams": 4, "azimuth_steps": 90, "range": 50}
    changes = {"lidars": 12, "zones": away, "trials": 4}
    allowed = {"lidar": short, "allow_blind_lidars": True}
    result = search(tmp_path, tracking, search=changes, **allowed)
    assert result.exit_code == 0, result.output
    assert (trials(tmp_path)["value.expected_ig"] == 0).all()


def test_several_objectives_with_prices(tmp_path, tracking):
    models = {
        "small": {"beams": 2, "azimuth_steps": 45, "price": 1},
        "large": {"beams": 16, "azimuth_steps": 180, "price": 10},
    }
    result = search(
        tmp_path,
        tracking,
        search={
            "lidars": [1, 3],
            "models": models,
            "objective": ["covered_entropy", "price"],
            "sampler": "nsga2",
            "trials": 40,
            "constraints": {"distance": 0.1, "price": 21},
        },
    )
    assert result.exit_code == 0, result.output
    table, found = trials(tmp_path), about(tmp_path)
    assert table.loc[table["feasible"], "value.price"].max() <= 21
    assert table["lidars"].nunique() == 3
    front = [found["rigs"][name]["values"] for name in found["best"]]
    assert len(front) > 1
    for one in front:
        assert not any(
            other["covered_entropy"] >= one["covered_entropy"]
            and other["price"] <= one["price"]
            and other != one
            for other in front
        )
    config = yaml.safe_load((tmp_path / "runs/small/sweep.yaml").read_text())
    mount = config["placements"]["found_1"]["mounts"][0]
    assert mount["lidar"] in (
        {"beams": 2, "azimuth_steps": 45},
        {"beams": 16, "azimuth_steps": 180},
    )
    read_sweep(tmp_path / "runs/small/sweep.yaml")


@pytest.mark.parametrize(
    "sampler", ["tpe", *(pytest.param(own, marks=pytest.mark.long) for own in ("qmc", "nsga2"))]
)
def test_the_outcome_does_not_depend_on_stops(tmp_path, tracking, monkeypatch, sampler):
    """A search that is killed while it asks, answers or tells ends as one that is not."""
    own = {"sampler": sampler}
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    for place in (whole, cut):
        place.mkdir()
    assert search(whole, tracking, name="w", search=own).exit_code == 0
    expected = pd.read_parquet(whole / "runs/w/trials.parquet").drop(columns="seconds")
    write = optuna.storages.journal.JournalFileBackend.append_logs
    for stop_after in (3, 20, 41, 57, 90, 200):
        left = stop_after

        def append(self, logs):
            nonlocal left
            left -= 1
            if left < 0:
                write(self, logs[:1])
                with journal_path(cut / "runs/c").open("ab") as file:
                    file.write(b'{"half a line')
                raise KeyboardInterrupt
            write(self, logs)

        monkeypatch.setattr(optuna.storages.journal.JournalFileBackend, "append_logs", append)
        result = search(cut, tracking, name="c", search=own)
        assert result.exit_code in (0, 130)
        monkeypatch.setattr(optuna.storages.journal.JournalFileBackend, "append_logs", write)
    assert search(cut, tracking, name="c", search=own).exit_code == 0
    found = pd.read_parquet(cut / "runs/c/trials.parquet").drop(columns="seconds")
    pd.testing.assert_frame_equal(found, expected)


def test_the_outcome_does_not_depend_on_workers(tmp_path, tracking):
    for name, ray in (("one", "debug"), ("two", {"num_cpus": 2})):
        result = search(tmp_path, tracking, name=name, ray=ray)
        assert result.exit_code == 0, result.output
    one, two = (
        pd.read_parquet(tmp_path / f"runs/{name}/trials.parquet").drop(columns="seconds")
        for name in ("one", "two")
    )
    pd.testing.assert_frame_equal(one, two)


def test_a_killed_process(tmp_path, tracking):
    """SIGKILL, at a moment when trials are there and others are not."""
    path = write_search(tmp_path, tracking={"uri": tracking}, name="k", search={"trials": 60})
    process = Forked(["search", str(path)], ROOT, tmp_path / "log.txt")
    journal = journal_path(tmp_path / "runs/k")
    give_up = time.monotonic() + GUARD_S
    while not (journal.exists() and journal.read_bytes().count(b"\n") > 300):
        assert process.poll() is None, (tmp_path / "log.txt").read_text()
        assert time.monotonic() < give_up
        time.sleep(0.02)
    process.kill()
    process.wait(GUARD_S)
    assert len(list(journal.read_bytes().splitlines())) > 0
    result = CliRunner().invoke(app, [str(path)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    found = pd.read_parquet(tmp_path / "runs/k/trials.parquet").drop(columns="seconds")
    assert search(tmp_path, tracking, name="w", search={"trials": 60}).exit_code == 0
    whole = pd.read_parquet(tmp_path / "runs/w/trials.parquet").drop(columns="seconds")
    pd.testing.assert_frame_equal(found, whole)
    client = connect(tracking)
    runs = client.search_runs([client.get_experiment_by_name("k").experiment_id], max_results=200)
    names = [run.data.tags["mlflow.runName"] for run in runs]
    assert sorted(names) == sorted(["k", *(f"trial {n}" for n in range(60))])


def test_an_emptied_journal_is_told(tmp_path, tracking):
    assert search(tmp_path, tracking, search={"trials": 4}).exit_code == 0
    before = trials(tmp_path).drop(columns="seconds")
    journal = journal_path(tmp_path / "runs/small")
    assert str(journal) not in search(tmp_path, tracking, search={"trials": 4}).output
    journal.write_bytes(b"")
    result = search(tmp_path, tracking, search={"trials": 4})
    assert result.exit_code == 0, result.output
    assert f"{journal} holds no trial" in result.output
    pd.testing.assert_frame_equal(trials(tmp_path).drop(columns="seconds"), before)
