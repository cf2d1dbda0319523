"""The run folder is read whole, or the error names what is wrong."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pandas as pd
import pytest
from made_up_run import NAMES, write_run

from lidarplace.boxes import CLASSES
from tracking.run_folder import RunFolder
from tracking.summary import headline_iou, seed_means, summary_table


@pytest.fixture
def copy(made_up_run, tmp_path):
    folder = tmp_path / "copy"
    shutil.copytree(made_up_run, folder)
    return folder


def test_everything_is_read(made_up_run):
    run = RunFolder.read(made_up_run)
    assert tuple(run.placements) == NAMES
    assert run.placements["line"][0].y == -0.6
    assert run.classes == CLASSES
    assert run.axes == ()
    assert run.roi.shape == (40, 40, 8)
    assert run.maps is not None
    assert tuple(run.maps.coverage) == NAMES
    assert run.maps.pog["Car"].shape == run.roi.shape[:2]
    assert run.frame is not None
    assert run.frame.points["line"].shape == (300, 4)
    assert run.frame.lidar["line"].shape == (300,)


def test_what_is_missing_is_named(copy, tmp_path):
    with pytest.raises(ValueError, match=r"nowhere is no run folder: it has no config.yaml, sweep"):
        RunFolder.read(tmp_path / "nowhere")
    results = pd.read_parquet(copy / "results.parquet")
    results.drop(columns="iou").to_parquet(copy / "results.parquet")
    with pytest.raises(ValueError, match=r"results.parquet has no column iou; found trial"):
        RunFolder.read(copy)
    sweep = json.loads((copy / "sweep.json").read_text())
    (copy / "sweep.json").write_text(json.dumps({k: v for k, v in sweep.items() if k != "roi"}))
    with pytest.raises(ValueError, match=r"sweep.json has no roi"):
        RunFolder.read(copy)
    (copy / "sweep.json").write_text("{")
    with pytest.raises(ValueError, match=r"sweep.json is no JSON"):
        RunFolder.read(copy)


def test_optional_files_may_be_missing(copy):
    for name in ("curves.parquet", "maps.npz", "frame.npz"):
        (copy / name).unlink()
    run = RunFolder.read(copy)
    assert (run.curves, run.maps, run.frame) == (None, None, None)
    assert run.tasks is not None


def test_means_over_seeds(made_up_run):
    run = RunFolder.read(made_up_run)
    means = seed_means(run.results)
    row = means.query(
        "placement == 'center' and `class` == 'Car' and metric == 'AP_R40_BEV' and iou == 0.5"
    ).iloc[0]
    values = run.results.query(
        "placement == 'center' and `class` == 'Car' and metric == 'AP_R40_BEV' and iou == 0.5"
    )["value"]
    assert row["mean"] == pytest.approx(np.mean(values))
    assert row["sd"] == pytest.approx(np.std(values, ddof=1))
    assert row["seeds"] == 2
    assert (means.loc[means["class"] == "Cyclist", "seeds"] == 0).all()


def test_the_summary_has_a_row_a_placement_best_first(made_up_run):
    run = RunFolder.read(made_up_run)
    table = summary_table(run)
    assert sorted(table["placement"]) == sorted(NAMES)
    assert table["Car 3D@0.7"].is_monotonic_decreasing
    assert table.columns.tolist() == [
        *("placement", "seeds", "Car S-MIG", "Car E-IG", "covered entropy", "Car 3D@0.7", "sd"),
        *("Car BEV@0.5", "Car BEV@0.7", "Pedestrian BEV@0.5", "recall@0.5"),
    ]
    line = table.set_index("placement").loc["line"]
    covered = run.surrogates.query("placement == 'line' and surrogate == 'covered_entropy'")
    assert line["covered entropy"] == pytest.approx(covered["value"].sum())
    own = run.results.query("placement == 'line' and `class` == 'all'")
    assert line["recall@0.5"] == pytest.approx(own["value"].mean())


def test_the_summary_tells_axes_and_detectors_apart(tmp_path):
    run = RunFolder.read(
        write_run(tmp_path / "axes", names=["a", "b"], detectors=("x", "y"), densities=(40, 120))
    )
    assert run.axes == ("scene.density",)
    table = summary_table(run)
    assert len(table) == 2 * 2 * 2
    assert not table.duplicated(["placement", "detector", "scene.density"]).any()
    row = table.query("placement == 'a' and detector == 'y' and `scene.density` == 120").iloc[0]
    s_mig = run.surrogates.query(
        "placement == 'a' and `class` == 'Car' and surrogate == 's_mig' and `scene.density` == 120"
    )
    assert row["Car S-MIG"] == s_mig["value"].item()


def test_the_headline_iou_is_kittis_where_it_was_evaluated():
    results = pd.DataFrame({"class": ["Car", "Car", "Cyclist"], "iou": [0.5, 0.7, 0.25]})
    assert headline_iou(results, "Car") == 0.7
    assert headline_iou(results, "Cyclist") == 0.25
    assert headline_iou(results, "Pedestrian") == 0.5
