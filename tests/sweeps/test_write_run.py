"""Tables of the run folder that say which objects were behind the numbers."""

import shutil
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import yaml

from sweeps.commands.failures import app
from sweeps.configuration.grid import read_sweep
from sweeps.plan.plan import read_plan
from sweeps.results.failure_frames import failure_frames
from sweeps.results.run_folder import _once
from sweeps.stages.collect import CollectStage
from sweeps.stages.recall import RecallStage
from sweeps.stages.requirements import RequirementsStage
from sweeps.stages.surrogates import SurrogatesStage
from sweeps.store.open import store_of
from tests.sweeps.small_log import write_sweep
from tests.sweeps.toy import call, ran
from tests.sweeps.written_tables import check_columns
from tracking.findings.failures import failures
from tracking.findings.groups import groups
from tracking.run_folders.sweep import RunFolder
from tracking.run_folders.sweep_tables import INDIVIDUALS, POINTS, REQUIREMENTS, SURROGATES, TABLES

pytestmark = pytest.mark.usefixtures("one_thread")


BODY = [[[-2.0, -0.9, 0.2], [2.0, 0.9, 1.5]]]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("sweep")
    config = {"grid": {"placement": ["center", "line"], "detector": ["pointpillars_tiny"]}}
    # With all studies.
    config |= {"classes": ["Car", "Pedestrian"], "surrogate": {"resolution": 0.8}}
    near = {"name": "near", "where": {"x": [3, 5], "y": [-1, 1]}, "what": "Car", "step": 1.0}
    config |= {"vehicle": BODY, "requirements": [near | {"at_least": {"points": 1}}]}
    sweep = read_sweep(write_sweep(path, "small.yaml", **config))
    return ran(sweep, path)[-1]


def test_tables_have_the_columns_that_their_models_tell(folder):
    for table in TABLES:
        written = pd.read_parquet(folder / table.file)
        if table.name == "promotions":
            assert written.shape == (0, 0)
            continue
        check_columns(written, table)
        assert len(written.columns) == len(table.columns), table.file


@pytest.mark.parametrize(
    ("table", "stages"),
    [
        (POINTS, [CollectStage]),
        (SURROGATES, [SurrogatesStage, RecallStage]),
        (REQUIREMENTS, [RequirementsStage]),
    ],
    ids=lambda value: getattr(value, "name", ""),
)
def test_rows_of_settings_that_differ_are_told_apart(table, stages):
    """Axes are columns for all keys that decide what a row says; or rows were there twice."""
    keys = {key.partition(".")[0] for stage in stages for key in stage.config_keys()}
    assert keys - {"placement", "classes"} <= set(table.axes)


def test_rows_that_trials_share_in_part_are_there_once():
    """A detector from a file has the test frames alone, one that is trained the others, too."""
    tested, trained = SimpleNamespace(key="test"), SimpleNamespace(key="train")
    rows = pd.DataFrame({"split": ["test", "train"], "object_id": [1, 2]})
    point = SimpleNamespace(placement="line", detector_name="second", seed=0)
    trial = SimpleNamespace(key="a", grid_point=SimpleNamespace(point=point, axes={}))
    parts = [(trial, [tested], lambda: rows[:1]), (trial, [tested, trained], lambda: rows)]
    pd.testing.assert_frame_equal(_once(INDIVIDUALS, (), parts), rows)


def test_individuals_of_both_splits_are_counted_once(folder):
    table = pd.read_parquet(folder / "individuals.parquet")
    # Four cars in every frame; three frames to train, one to test.
    by_split = {split: rows["boxes"].tolist() for split, rows in table.groupby("split")}
    assert by_split == {"test": [1] * 4, "train": [3] * 4}
    results = pd.read_parquet(folder / "results.parquet")
    cars = results.loc[results["class"] == "Car", "ground_truths"]
    assert set(cars) == {4}


def test_what_hangs_on_each_individual_stands_beside_the_results_and_the_vehicle(folder):
    run = RunFolder.read(folder)
    np.testing.assert_array_equal(run.sweep.body.boxes, BODY)
    assert run.sweep.body.mesh is None
    assert run.left_out is not None
    keys = ["trial", "placement", "detector", "seed", "class", "metric", "iou"]
    assert not run.left_out.duplicated([*keys, "unit", "left_out"]).any()
    finite = run.results[run.results["value"].notna()].set_index(keys).index
    assert set(run.left_out.set_index(keys).index) == set(finite)
    cars = run.left_out[(run.left_out["class"] == "Car") & (run.left_out["metric"] == "recall")]
    of_unit = cars.groupby(["unit", "trial", "iou"])["ground_truths"].sum()
    assert set(of_unit.index.get_level_values("unit")) == {"route", "individual", "nothing"}
    assert set(of_unit.drop("nothing")) == {4}
    assert set(of_unit["nothing"]) == {0}


def test_found_objects_make_the_recall_of_their_class(folder):
    objects, hits = (pd.read_parquet(folder / f"{name}.parquet") for name in ("objects", "found"))
    results = pd.read_parquet(folder / "results.parquet").query("metric == 'class_recall_3D'")
    recall = results[(results["class"] == "Car") & (results["iou"] == 0.7)].set_index("trial")
    merged = hits.merge(objects, on="object")
    assert len(merged) == 2 * 4
    mean = 100 * merged.groupby("trial")["found"].mean()
    assert mean.to_dict() == pytest.approx(recall["value"].to_dict())
    points = pd.read_parquet(folder / "points.parquet")
    by_rig = merged.merge(results[["trial", "placement"]].drop_duplicates()).groupby("placement")
    total = (points["mean"] * points["objects"]).groupby(points["placement"]).sum()
    assert by_rig["points"].sum().to_dict() == pytest.approx(total.to_dict())
    assert (merged["visibility"] > 0).all()
    assert set(merged["frame"]) == {3}


def test_frames_have_the_points_on_objects_and_the_detections_that_were_evaluated(folder):
    """One car is taken to be found under the one rig alone."""
    _, plan = read_plan(folder / "config.yaml")
    store = store_of(read_sweep(folder / "config.yaml"))
    run = RunFolder.read(folder)
    run.found["found"] = run.found["object"] == 2
    run.found.loc[run.found["trial"] == plan.trials[1].key, "found"] = False
    comparison = failures(run, next(groups(run)), ("center", "line"))
    frames = failure_frames(comparison, {trial.key: trial for trial in plan.trials}, store)
    assert frames.objects.tolist() == [2]
    for rig, trial in enumerate(plan.trials):
        (task,) = trial.collect_test
        whole = store.load(task)[0][:, :3]
        points = set(map(tuple, frames.points[f"0/{rig}"].tolist()))
        assert points <= set(map(tuple, whole.tolist()))
        car = run.objects.iloc[2]
        near = np.abs(whole - car[["x", "y", "z"]].to_numpy(float)) <= [2.2, 0.9, 0.8]
        on_it = set(map(tuple, whole[near.all(axis=1)].tolist()))
        assert on_it <= points
        detections = store.load(trial.evaluate).detections
        assert len(frames.detections[f"0/{rig}"]) == (detections["frame"] == 3).sum()


def test_the_command_compares_two_rigs(folder, tmp_path):
    out = tmp_path / "out"
    result = call(app, folder, "--rigs", "line,center", "--out", out)
    assert "Of 4 objects (4 individuals) line finds " in result.output
    assert "no frames are shown" not in result.output
    objects = pd.read_parquet(out / "objects.parquet")
    assert len(objects) == len(pd.read_csv(out / "objects.csv")) == 4
    counts = pd.read_csv(out / "tables" / "failures.csv")
    assert counts["line alone"].iloc[0] == objects["found by line alone"].sum()
    assert (out / "failures.html").is_file()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--rigs", "line"], "--rigs line: expected two placements, such as center,line"),
        (["--rigs", "line,middle"], "has no placement middle; expected center, line"),
        (["--where", "evaluator=me"], "--where evaluator=me: "),
    ],
)
def test_a_mistake_is_one_line(folder, words, said):
    result = call(app, folder, *words, code=2)
    assert said in " ".join(result.output.split())


def test_without_results_in_the_store_there_are_counts_alone(folder, tmp_path):
    shutil.copytree(folder, tmp_path / "moved")
    config = yaml.safe_load((folder / "config.yaml").read_text())
    (tmp_path / "moved" / "config.yaml").write_text(
        yaml.safe_dump(config | {"output": str(tmp_path / "elsewhere")})
    )
    words = [tmp_path / "moved", "--rigs", "line,center", "--out", tmp_path / "out"]
    result = call(app, *words)
    assert "no frames are shown: the store" in result.output
    (tmp_path / "moved" / "found.parquet").unlink()
    result = call(app, *words, code=2)
    assert "found.parquet: missing, as the sweep ran before" in " ".join(result.output.split())
