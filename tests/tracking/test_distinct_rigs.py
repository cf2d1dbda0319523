"""Copies of a rig under two names: one placement."""

import json
import shutil

import numpy as np
import pandas as pd
import pytest

from tests.tracking.made_up_run import report_of, write_run
from tracking.findings.groups import copies, without
from tracking.run_folders.sweep import RunFolder


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """`again` is `b`: mounts, surrogates and results; c has the mounts of a only."""
    path = write_run(tmp_path_factory.mktemp("runs") / "twice", ("a", "b", "c", "again"))
    sweep = json.loads((path / "sweep.json").read_text())
    for name in ("b", "again"):
        sweep["placements"][name] = [[0.5, 0.0, 2.0, 0.0, 0.0, 0.0]]
    (path / "sweep.json").write_text(json.dumps(sweep))
    for name in ("surrogates", "results"):
        table = pd.read_parquet(path / f"{name}.parquet").set_index("placement")
        table.loc["again", "value"] = table.loc["b", "value"].to_numpy()
        table.reset_index().to_parquet(path / f"{name}.parquet", index=False)
    return path


def test_equal_mounts_and_surrogates_are_a_copy_and_other_lidars_on_the_same_mounts_none(folder):
    run = RunFolder.read(folder)
    assert copies(run) == {"again": "b"}
    assert run.placements["a"] == run.placements["c"]


def test_nothing_of_it_is_left(folder):
    run = without(RunFolder.read(folder), {"again"})
    assert list(run.placements) == ["a", "b", "c"]
    assert "again" not in set(run.results["placement"]) | set(run.surrogates["placement"])
    assert set(run.curves["trial"]) == set(run.trials["trial"])
    assert without(run, set()) is run


def test_the_report_counts_it_once_and_says_so(folder, tmp_path):
    path = shutil.copytree(folder, tmp_path / "run")
    page = report_of(path, "best", "by_class").read_text(encoding="utf-8")
    assert "The same rig under two names is counted once: again is b." in page
    table = pd.read_csv(next((path / "tables").glob("best-*car*.csv")))
    assert sorted(table["placement"]) == ["a", "b", "c"]
    assert np.isclose(table["probability_best"].sum(), 1)
