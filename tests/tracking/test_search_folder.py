"""Folders of a search that the reader refuses, and the messages."""

import json
import math

import numpy as np
import pandas as pd
import pytest

from tests.tracking.made_up_search import write_search
from tracking.run_folders.search import SearchFolder
from tracking.run_folders.search_json import SearchResult


@pytest.fixture
def folder(tmp_path):
    return write_search(tmp_path / "made_up", trials=10, complete=False)


def test_a_complete_folder_is_read_whole(tmp_path):
    run = SearchFolder.read(write_search(tmp_path / "whole", trials=10))
    for table in (run.bound, run.greedy, run.robustness, run.verified):
        assert len(table) > 0
    assert [*run.pog] == [*run.unseen] == ["Car", "Cyclist"]
    assert [*run.unseen["Car"]] == ["found_1", "line"]
    rig = run.rig_of(run.trials.loc[7])
    best = run.search.rigs["found_1"]
    np.testing.assert_allclose(rig.mounts, best.mounts, atol=1e-12)
    assert (rig.models, rig.zones, rig.searched) == (best.models, best.zones, best.searched)


def test_what_is_not_known_is_null_in_the_file(folder):
    search = SearchResult.read(folder)
    line = search.rigs["line"].model_copy(update={"values": {"expected_ig": math.nan}})
    rigs = search.rigs | {"line": line}
    search.model_copy(update={"rigs": rigs}).write(folder)
    assert json.loads((folder / "search.json").read_text())["rigs"]["line"]["values"] == {
        "expected_ig": None
    }
    again = SearchResult.read(folder)
    assert again.rigs["found_1"] == search.rigs["found_1"]
    assert math.isnan(again.rigs["line"].value(search.first))


def test_absent_parts_are_none_or_empty(folder):
    run = SearchFolder.read(folder)
    assert (run.bound, run.greedy, run.robustness, run.verified) == (None,) * 4
    assert (run.pog, run.unseen) == ({}, {})


def test_a_pose_that_is_missing_is_nan(folder):
    path = folder / "trials.parquet"
    trials = pd.read_parquet(path)
    for missing in (pd.array([None] * len(trials), "Int64"), [None] * len(trials)):
        trials.assign(**{"lidar_1.z_m": missing}).to_parquet(path)
        assert SearchFolder.read(folder).trials["lidar_1.z_m"].isna().all()
