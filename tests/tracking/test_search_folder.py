"""What the reader of a search's folder refuses, and how."""

import json
import math

import numpy as np
import pandas as pd
import pytest
from made_up_search import write_search

from tracking.run_folders.search import SearchFolder
from tracking.run_folders.search_json import SearchResult


@pytest.fixture
def folder(tmp_path):
    return write_search(tmp_path / "made_up", trials=10, complete=False)


def change(folder, **keys):
    file = folder / "search.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | keys))


def test_a_complete_folder_is_read_whole(tmp_path):
    run = SearchFolder.read(write_search(tmp_path / "whole", trials=10))
    for table in (run.bound, run.greedy, run.robustness, run.verified):
        assert len(table) > 0
    assert [*run.pog] == [*run.unseen] == ["Car", "Cyclist"]
    assert [*run.unseen["Car"]] == ["found_1", "line"]
    rig = run.rig_of(run.trials.loc[7])
    found = run.search.rigs["found_1"]
    np.testing.assert_allclose(rig.mounts, found.mounts, atol=1e-12)
    assert (rig.models, rig.zones, rig.searched) == (found.models, found.zones, found.searched)


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


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"objectives": []}, "needs at least one"),
        ({"best": ["nobody"]}, "has no 'nobody'"),
        ({"seed": "first"}, "seed"),
        ({"rigs": {}}, "rigs: has no"),
        ({"bound": {"value": "high"}}, "bound.value"),
    ],
)
def test_a_bad_key_is_named_with_the_file(folder, keys, words):
    change(folder, **keys)
    with pytest.raises(ValueError, match=words) as caught:
        SearchFolder.read(folder)
    assert "search.json" in str(caught.value)


def test_the_best_rig_needs_every_value(folder):
    search = json.loads((folder / "search.json").read_text())
    search["rigs"]["found_1"]["values"]["expected_ig"] = None
    change(folder, rigs=search["rigs"])
    with pytest.raises(ValueError, match="'found_1' has no value of expected_ig"):
        SearchFolder.read(folder)


def test_a_rig_needs_a_model_for_each_mount(folder):
    search = json.loads((folder / "search.json").read_text())
    search["rigs"]["line"]["models"] = ["paper"]
    change(folder, rigs=search["rigs"])
    with pytest.raises(ValueError, match="4 mounts, 1 models, 4 zones"):
        SearchFolder.read(folder)


def test_a_missing_column_is_named_with_those_found(folder):
    table = pd.read_parquet(folder / "trials.parquet").drop(columns="value.expected_ig")
    table.to_parquet(folder / "trials.parquet")
    with pytest.raises(ValueError, match=r"value.expected_ig: missing column; found"):
        SearchFolder.read(folder)


@pytest.mark.parametrize(
    ("column", "values", "said"),
    [
        ("lidar_1.z_m", "high", "numbers, found str, such as 'high'"),
        ("lidar_1.yaw_deg", math.inf, "finite numbers, found infinity"),
        ("lidar_1.model", 5, "text, found int64, such as .*5"),
    ],
)
def test_columns_of_lidars_are_checked(folder, column, values, said):
    path = folder / "trials.parquet"
    pd.read_parquet(path).assign(**{column: values}).to_parquet(path)
    with pytest.raises(ValueError, match=f"trials.parquet: column {column} must hold {said}"):
        SearchFolder.read(folder)


def test_a_pose_that_is_missing_is_nan(folder):
    path = folder / "trials.parquet"
    trials = pd.read_parquet(path)
    for missing in (pd.array([None] * len(trials), "Int64"), [None] * len(trials)):
        trials.assign(**{"lidar_1.z_m": missing}).to_parquet(path)
        assert SearchFolder.read(folder).trials["lidar_1.z_m"].isna().all()
