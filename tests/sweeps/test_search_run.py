"""A whole search through the command line, on a small log."""

import json
import pickle
from functools import cache

import optuna
import pandas as pd
import pytest
import yaml

from lidarplace import OccupancyGrid, Placement, Roi, evaluate
from lidarplace.configuration.placement import read_placement
from sweeps.configuration.grid import read_sweep
from sweeps.execution.backends import InProcess, Later
from sweeps.search.problem.problem import read_problem
from sweeps.search.trials.study import journal_path
from tests.sweeps.search_files import run_search, searched, train_log, write_search
from tests.sweeps.written_tables import check_columns
from tracking.mlflow.connection import connect
from tracking.mlflow.experiment_page import VIEW_TAG
from tracking.run_folders.search import SearchFolder
from tracking.run_folders.search_tables import BOUND, GREEDY, ROBUSTNESS

AWAY = {"away": {"x": [-100, -99], "y": [-0.6, 0.6], "z": [1, 2]}}
"""From there short LiDARs see nothing of the ROI."""
SHORT = {"beams": 4, "azimuth_steps": 90, "range": 50}


def trials(run, name="small"):
    """The trials of a run folder in a folder, but for their seconds."""
    return pd.read_parquet(run / f"runs/{name}/trials.parquet").drop(columns="seconds")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("search")
    searched(folder)
    return folder


@pytest.fixture(scope="module")
def run(folder):
    return SearchFolder.read(folder / "runs/small")


def test_the_best_trial_is_what_the_files_say(run):
    search, table = run.search, run.trials
    assert len(table) == 12
    best = table[table["feasible"]]["value.expected_ig"].max()
    own = search.rigs[search.best[0]]
    assert own.values["expected_ig"] == pytest.approx(best, rel=1e-12)  # all rays in both
    bound = search.bound
    assert bound.greedy <= bound.value <= bound.by_gains
    assert bound.gap_percent == pytest.approx(100 * (1 - best / bound.value))
    refined = search.rigs["refined"].values["expected_ig"]
    assert table.loc[0, "value.expected_ig"] == pytest.approx(refined, rel=1e-9), "the first trial"
    assert refined >= bound.greedy * (1 - 1e-9)
    for own in (search.trials_table, BOUND, GREEDY, ROBUSTNESS):
        check_columns(pd.read_parquet(run.path / own.file), own)


def test_the_value_is_that_of_the_library(folder, run):
    """The placement file and the log alone give the value again."""
    problem = read_problem(folder / "small.yaml")
    log, roi = train_log(folder / "log"), Roi((0, 40), (-20, 20), (0, 4), 0.8)
    grid = OccupancyGrid.from_boxes(log.boxes, roi, "Car", frames=len(log.frames))
    placement = run.path / "placement.yaml"
    assert not {"&", "*"} & set(placement.read_text()), "no anchors"
    rig = read_placement(placement, problem.file.lidar.lidar())
    assert isinstance(rig, Placement)
    value = evaluate(grid, rig, surrogates=["expected_ig"]).expected_ig
    assert value == pytest.approx(run.search.rigs["found_1"].values["expected_ig"], rel=1e-9)


def test_a_sweep_takes_the_result_as_it_is(run):
    sweep = read_sweep(run.path / "sweep.yaml")
    names = [point.point.placement for point in sweep.points]
    assert names[:3] == ["found_1", "found_2", "found_3"]
    assert len(set(names)) == 3 + 8


def test_mlflow_has_a_run_for_every_trial(run):
    client = connect(run.search.tracking_uri)
    experiment = client.get_experiment_by_name("small")
    runs = client.search_runs([experiment.experiment_id], max_results=100)
    by_name = {entry.data.tags["mlflow.runName"]: entry.data for entry in runs}
    assert by_name.keys() >= {"small", *(f"trial {n}" for n in range(12))}
    one = by_name["trial 3"]
    value = run.trials.loc[3, "value.expected_ig"]
    assert one.metrics["expected_ig"] == pytest.approx(value)
    assert one.params["lidar_1.model"] == "lidar"
    assert one.tags["lidarplace.version"]
    assert experiment.tags["mlflow.note.content"].startswith("A search")
    view = json.loads(experiment.tags[VIEW_TAG])
    assert view["selectedColumns"][:2] == ["metrics.`expected_ig`", "metrics.`feasible`"]
    assert view["orderByAsc"] is False
    assert "trials: 12" in by_name["small"].tags["mlflow.note.content"]


def test_robustness_has_a_row_a_case(run):
    cases = run.robustness[run.robustness["rig"] == "found_1"].set_index("case")
    assert list(cases.index) == ["as designed", "mounts off", "LiDAR 1 fails", "LiDAR 2 fails"]
    assert cases.loc["as designed", "share"] == 1
    assert cases.loc["mounts off", "draws"] == 3
    assert (cases.loc[["LiDAR 1 fails", "LiDAR 2 fails"], "share"] < 1).all()


def test_a_search_begins_with_the_rig_that_one_has(tmp_path):
    mounts = [{"x": 0.1, "y": 0.2, "z": 2.0, "roll": 0.1}, {"x": -0.3, "z": 1.9}]
    options = {"start": ["mine"], "greedy": {"position_step": 0.5, "warm_start": False}}
    placements = {"mine": {"mounts": mounts}}
    options |= {"models": {"one": {"beams": 4, "azimuth_steps": 90, "price": 7657}}, "trials": 4}
    options |= {"constraints": {"price": 16_000}}
    run, output = searched(tmp_path, placements=placements, search=options)
    lines = output.splitlines()
    begins = lines.index("greedy choice, then its upper bound, up to 30 s more …")
    assert lines[begins + 1].startswith("greedy choice from "), "before a minute of silence"
    first = run.trials.loc[0]
    positions = {(first[f"lidar_{i}.x_m"], first[f"lidar_{i}.y_m"]) for i in (1, 2)}
    assert positions == {(0.1, 0.2), (-0.3, 0.0)}
    assert run.search.baseline == "mine"
    assert {rig.role for rig in run.search.rigs.values()} == {"found", "greedy", "plain"}
    assert {rig.models for rig in run.search.rigs.values()} == {("one", "one")}
    assert "15,314" in output
    refined = run.search.rigs["refined"].values["expected_ig"]
    assert refined >= first["value.expected_ig"]


def test_more_trials_go_on_where_it_stopped(folder):
    before = trials(folder)
    run_search(folder / "small.yaml", "--set", "search.trials=16")
    after = trials(folder)
    pd.testing.assert_frame_equal(after.iloc[:12], before)
    assert len(after) == 16


def test_s_mig_comes_with_a_warning(tmp_path):
    output = run_search(write_search(tmp_path, search={"objective": "s_mig"}), "--dry-run")
    assert "highest for a placement that sees nothing" in " ".join(output.split())


def test_no_feasible_placement_and_nothing_of_an_earlier_search(tmp_path):
    """Of one that found some, results would be of another problem."""
    searched(tmp_path, search={"trials": 4})
    run = tmp_path / "runs/small"
    (run / "verified.parquet").touch()
    limits = {"constraints": {"distance": 1.61, "body_share": 0.9}, "greedy": None, "trials": 4}
    found, output = searched(tmp_path, code=1, search=limits)
    assert "No rig keeps all constraints" in output
    least = found.trials["violation.distance"].min()
    never = f"No trial kept distance, which the best of them broke by {least:.3g} m."
    assert never in output
    left = {path.name for path in run.iterdir()}
    assert left >= {"search.json", "search.html", "trials.parquet", "config.yaml", "optuna.journal"}
    assert not left & {
        *("placement.yaml", "sweep.yaml", "maps.npz", "bound.parquet", "greedy.parquet"),
        *("robustness.parquet", "verified.parquet"),
    }


def test_two_lidars_in_one_place(tmp_path):
    point = {"point": {"x": 0, "y": 0, "z": 2}}
    options = {"zones": point, "roll_deg": 0, "constraints": {"distance": 0}, "greedy": None}
    options |= {"lidars": 1, "fixed": [{"z": 2}], "trials": 4}
    _, output = searched(tmp_path, code=1, search=options)
    assert "All 4 trials put two LiDARs in one place." in output


def test_an_objective_that_is_undefined(tmp_path):
    options = {"objective": "m_sog", "zones": AWAY, "trials": 2, "batch_size": 2}
    run, output = searched(tmp_path, code=1, search=options, lidar=SHORT)
    assert "trial 0 failed: an objective is undefined" in output
    assert (run.trials["state"] == "FAIL").all()


def test_a_space_without_any_freedom_is_evaluated_once(tmp_path):
    """And a class may not occur."""
    options = {"lidars": 1, "zones": {"point": {"x": 0.2, "y": 0.1, "z": 2}}, "roll_deg": 3}
    run, _ = searched(tmp_path, search=options | {"trials": 6}, classes=["Car", "Pedestrian"])
    assert (run.search.trials, run.search.evaluations) == (6, 1)
    assert run.trials["value.expected_ig"].nunique() == 1
    assert run.search.bound.gap_percent == pytest.approx(0, abs=1e-3)


def test_twelve_lidars_and_an_objective_that_is_constant(tmp_path):
    changes = {"lidars": 12, "zones": AWAY, "trials": 4}
    run, _ = searched(tmp_path, search=changes, lidar=SHORT, allow_blind_lidars=True)
    assert (run.trials["value.expected_ig"] == 0).all()


def test_several_objectives_with_prices(tmp_path):
    models = {
        "small": {"beams": 2, "azimuth_steps": 45, "price": 1},
        "large": {"beams": 16, "azimuth_steps": 180, "price": 10},
    }
    wanted = {"objective": ["covered_entropy", "price"], "sampler": "nsga2", "trials": 24}
    limits = {"lidars": [1, 3], "constraints": {"distance": 0.1, "price": 21}}
    run, _ = searched(tmp_path, search={"models": models} | wanted | limits)
    table = run.trials
    assert table.loc[table["feasible"], "value.price"].max() <= 21
    assert table["lidars"].nunique() == 3
    values = [run.search.rigs[name].values for name in run.search.best]
    front = [(prices["covered_entropy"], prices["price"]) for prices in values]
    assert len(front) > 1
    for gain, price in front:
        assert not any(g >= gain and p <= price and (g, p) != (gain, price) for g, p in front)
    config = yaml.safe_load((run.path / "sweep.yaml").read_text())
    prices = [{k: v for k, v in model.items() if k != "price"} for model in models.values()]
    assert config["placements"]["found_1"]["mounts"][0]["lidar"] in prices
    read_sweep(run.path / "sweep.yaml")


@pytest.mark.parametrize(
    "sampler",
    ["tpe", *(pytest.param(settings, marks=pytest.mark.long) for settings in ("qmc", "nsga2"))],
)
def test_the_outcome_does_not_depend_on_stops(tmp_path, monkeypatch, sampler):
    """A search that is killed while it asks, answers or tells ends as one that is not."""
    settings = {"sampler": sampler, "greedy": None}
    searched(tmp_path, name="w", search=settings)
    path = write_search(tmp_path, name="c", search=settings)
    journal = optuna.storages.journal.JournalFileBackend
    write = journal.append_logs
    for stop_after in (3, 20, 57, 200):
        left = stop_after

        def append(self, logs):
            nonlocal left
            left -= 1
            if left < 0:
                write(self, logs[:1])
                with journal_path(tmp_path / "runs/c").open("ab") as file:
                    file.write(b'{"half a line')
                raise KeyboardInterrupt
            write(self, logs)

        with monkeypatch.context() as patched:
            patched.setattr(journal, "append_logs", append)
            run_search(path, codes=(0, 130))
    run_search(path)
    pd.testing.assert_frame_equal(trials(tmp_path, "c"), trials(tmp_path, "w"))


class Elsewhere(InProcess):
    """Jobs get copies, as in other processes, and those that began last end first."""

    def __init__(self):
        self.jobs = []

    def share(self, value):
        return pickle.loads(pickle.dumps(value))

    def submit(self, function, *arguments, **options):
        copy, number = pickle.loads(pickle.dumps(arguments)), len(self.jobs)
        self.jobs.append(cache(lambda: function(*copy)))

        def result():
            for job in self.jobs[:number:-1]:
                job()
            return self.jobs[number]()

        return Later(result, ())


@pytest.mark.parametrize("ray", [pytest.param({"num_cpus": 2}, marks=pytest.mark.long), "debug"])
def test_the_outcome_does_not_depend_on_workers(folder, tmp_path, monkeypatch, ray):
    if ray == "debug":
        monkeypatch.setattr("sweeps.execution.backends.InProcess", Elsewhere)
    searched(tmp_path, name="two", ray=ray)
    pd.testing.assert_frame_equal(trials(folder).iloc[:12], trials(tmp_path, "two"))


def test_an_emptied_journal_is_told(tmp_path):
    run, _ = searched(tmp_path, search={"trials": 4, "greedy": None})
    before, journal = trials(tmp_path), journal_path(run.path)
    assert str(journal) not in run_search(tmp_path / "small.yaml")
    journal.write_bytes(b"")
    assert f"{journal} holds no trial" in run_search(tmp_path / "small.yaml")
    pd.testing.assert_frame_equal(trials(tmp_path), before)
