"""Tables of the run folder that say which objects were behind the numbers."""

from __future__ import annotations

import pandas as pd
import pytest
import yaml
from small_log import write_small_log
from test_detector_sweep import SWEEP, Loud
from written_tables import check_columns

from sweeps.configuration.grid import read_sweep
from sweeps.execution.backends import InProcess
from sweeps.execution.execute import Outcome, execute
from sweeps.plan.plan import make_plan
from sweeps.results.promotion import Promotion
from sweeps.results.run_folder import Run, write_run
from sweeps.store.local import Store
from tracking.run_folders.sweep import RunFolder
from tracking.run_folders.sweep_tables import TABLES

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("sweep")
    write_small_log(path / "log")
    grid = {"placement": ["center", "line"], "detector": ["pointpillars_tiny"]}
    config = path / "small.yaml"
    scene = {"source": "log", "folder": str(path / "log")}
    own = {"scene": scene, "grid": grid, "output": str(path / "runs")}
    own["surrogate"] = {"resolution": SWEEP["surrogate"]["resolution"]}  # all that can be studied
    config.write_text(yaml.safe_dump(SWEEP | own))
    sweep = read_sweep(config)
    plan, store, outcome = make_plan(sweep), Store(path / "store"), Outcome()
    execute(plan.tasks, store, InProcess(), Loud(), outcome)
    run = Run(outcome, Promotion(complete=True), set(), 1, "sweeps.run small.yaml", 0.0, 1.0)
    write_run(path / "run", sweep, plan, store, run)
    return path / "run"


def test_tables_have_the_columns_that_their_models_tell(folder):
    for table in TABLES:
        written = pd.read_parquet(folder / table.file)
        if table.name == "promotions":
            assert written.shape == (0, 0)
            continue
        check_columns(written, table)
        assert len(written.columns) == len(table.columns), table.file


def test_individuals_of_both_splits_are_counted_once(folder):
    found = pd.read_parquet(folder / "individuals.parquet")
    # Four cars in every frame; three frames to train, one to test.
    by_split = {split: own["boxes"].tolist() for split, own in found.groupby("split")}
    assert by_split == {"test": [1] * 4, "train": [3] * 4}
    results = pd.read_parquet(folder / "results.parquet")
    cars = results.loc[results["class"] == "Car", "ground_truths"]
    assert set(cars) == {4}


def test_what_hangs_on_each_individual_stands_beside_the_results(folder):
    run = RunFolder.read(folder)
    assert run.left_out is not None
    keys = ["trial", "placement", "detector", "seed", "class", "metric", "iou"]
    assert not run.left_out.duplicated([*keys, "unit", "left_out"]).any()
    known = run.results[run.results["value"].notna()].set_index(keys).index
    assert set(run.left_out.set_index(keys).index) == set(known)
    cars = run.left_out[(run.left_out["class"] == "Car") & (run.left_out["metric"] == "recall")]
    of_unit = cars.groupby(["trial", "iou", "unit"])["ground_truths"].sum()
    assert set(of_unit) == {4}
    assert set(of_unit.index.get_level_values("unit")) == {"route", "individual"}
