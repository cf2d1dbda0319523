"""Metrics of no single IoU wherever metrics are read: report, summary, search, MLflow."""

import shutil
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from lidarplace.base.metrics import EVERY_IOU, RANKING
from sweeps.configuration.objective import ObjectiveSettings
from sweeps.configuration.sweep import Rung
from sweeps.results.trial_results import headline_value
from sweeps.search.trials.aggregate import weighted_value
from tests.tracking.made_up_run import report_of
from tracking.findings.summary import seed_means, summary_table
from tracking.kitti_iou import at_headline_iou, at_headline_ious, headline_iou
from tracking.mlflow.content import trial_metrics
from tracking.report.analysis import Analysis
from tracking.report.sections.ceiling import reliability_section
from tracking.run_folders.sweep import RunFolder

LIKE = {"AP_R40_3D_mean": "AP_R40_3D", "mean_overlap": "recall"}


def with_them(table):
    """The table with rows of the new metrics, each like an older one at IoU 0.5."""
    new = [
        table[(table["metric"] == old) & (table["iou"] == 0.5)].assign(metric=name, iou=EVERY_IOU)
        for name, old in LIKE.items()
    ]
    return pd.concat([table, *new], ignore_index=True)


@pytest.fixture(scope="module")
def folder(made_up_run, tmp_path_factory):
    folder = shutil.copytree(made_up_run, tmp_path_factory.mktemp("every") / "run")
    for name in ("results", "left_out"):
        table = pd.read_parquet(folder / f"{name}.parquet")
        with_them(table).to_parquet(folder / f"{name}.parquet", index=False)
    return folder


@pytest.fixture(scope="module")
def run(folder):
    return RunFolder.read(folder)


def test_they_have_an_iou_of_their_own_and_change_no_other(run, made_up_run):
    old = RunFolder.read(made_up_run).results
    for name in (*run.classes, "all"):
        assert headline_iou(run.results, name) == headline_iou(old, name)
        assert headline_iou(run.results, name, "mean_overlap") == EVERY_IOU
        rows = at_headline_iou(run.results, run.results, name, "mean_overlap")
        assert len(rows) == 2 * len(run.placements)
    headline_rows = at_headline_ious(run.results, run.results, "Car")
    wanted = dict.fromkeys(("AP_R40_3D", "AP_R40_BEV", "recall"), 0.7)
    wanted |= dict.fromkeys(LIKE, EVERY_IOU)
    assert set(zip(headline_rows["metric"], headline_rows["iou"], strict=True)) == {*wanted.items()}


def test_their_intervals_allow_for_the_test_objects(run):
    means = seed_means(run.results, run.axes, run.left_out)
    for name, old in LIKE.items():
        new = at_headline_iou(means, run.results, "Car", name)
        same = means[(means["class"] == "Car") & (means["metric"] == old) & (means["iou"] == 0.5)]
        for column in ("mean", "sample_sd", "low", "high", "half"):
            assert np.isfinite(new[column]).all()
            assert new[column].tolist() == pytest.approx(same[column].tolist())


def test_the_summary_has_them_of_the_first_class(run):
    columns = list(summary_table(run).columns)
    new = [name for name in columns if "overlap" in name or "0.3" in name]
    assert new == ["Car 3D@0.3–0.8", "Car overlap"]
    assert not [name for name in columns if name.endswith("@0")]


def test_the_report_names_them_without_an_iou(folder):
    text = report_of(folder, "placements", "sensitivity").read_text(encoding="utf-8")
    assert ">3D AP @ 0.3–0.8 (%)<" in text
    assert ">mean overlap (%)<" in text
    assert "@ 0 " not in text
    assert "@ 0<" not in text


def test_rungs_and_objectives_may_ask_for_them():
    assert set(LIKE) <= set(RANKING)
    Rung.model_validate({"by": "mean_overlap", "keep": 1, "set": {"training.epochs": 1}})
    rows = [("Car", "AP_R40_3D", 0.7, 20.0), ("Car", "AP_R40_3D_mean", EVERY_IOU, 50.0)]
    rows += [("Cyclist", "AP_R40_3D_mean", EVERY_IOU, 30.0)]
    rows += [("Car", "mean_overlap", EVERY_IOU, 61.0), ("all", "mean_overlap", EVERY_IOU, 60.0)]
    metrics = pd.DataFrame(rows, columns=["class", "metric", "iou", "value"])
    assert headline_value(metrics, "AP_R40_3D_mean", "Car") == 50
    for by, value in (("AP_R40_3D_mean", 40), ("mean_overlap", 60)):
        objective = ObjectiveSettings.model_validate({"by": by, "evaluator": "generalist"})
        assert objective.measured
        assert objective.best == "maximize"
        assert weighted_value(objective, ["Car", "Cyclist"], metrics) == value
    of_car = ObjectiveSettings.model_validate({"by": "mean_overlap", "weights": {"Car": 1.0}})
    assert weighted_value(of_car, ["Car", "Cyclist"], metrics) == 61


def test_mlflow_has_them_and_surrogates_by_name_and_class():
    rows = [("AP_R40_3D", "Car", 0.7, 19.99623), ("mean_overlap", "all", EVERY_IOU, 60.0)]
    results = pd.DataFrame(rows, columns=["metric", "class", "iou", "value"])
    columns = ["surrogate", "class", "value"]
    surrogates = pd.DataFrame([("s_mig", "Pedestrian", -30123.456)], columns=columns)
    named = {"AP_R40_3D.Car.0.70": 20.0, "mean_overlap.all": 60.0}
    assert trial_metrics(results, surrogates) == named | {"surrogate.s_mig.Pedestrian": -30123.0}


def test_the_report_tells_how_reliable_each_metric_is(run):
    """Three splits: ranks by hand, Spearman and Brown's 2 ρ / (1 + ρ)."""
    rng, parts = np.random.default_rng(0), []
    for metric in ("AP_R40_3D", "AP_R40_3D_mean", "mean_overlap"):
        rows = run.results[(run.results["metric"] == metric) & (run.results["class"] == "Car")]
        for side in ("0a", "0b", "1a", "1b", "2a", "2b"):
            noise = 6 * rng.standard_normal(len(rows)) * (metric == "AP_R40_3D")
            noise += 20 * rng.standard_normal(len(rows)) * (metric == "mean_overlap")
            parts.append(rows.assign(unit="half", left_out=side, value=rows["value"] + noise))
    halves = pd.concat(parts).drop(columns="difficulty")
    together = replace(run, left_out=pd.concat([run.left_out, halves]))
    (table,) = reliability_section(Analysis(together)).tables
    reliable = {}
    for (metric, iou), rows in halves.groupby(["metric", "iou"]):
        deviations = rows.pivot_table("value", "placement", "left_out").rank() - 3
        rho = [(deviations[f"{i}a"] * deviations[f"{i}b"]).sum() / 10 for i in range(3)]
        mean = max(np.mean(rho), 0)
        reliable[metric, iou] = 2 * mean / (1 + mean)
    names = ["3D AP @ 0.7", "3D AP @ 0.3–0.8", "mean overlap"]
    assert [row[2] for row in table.rows] == names
    wanted = [("AP_R40_3D", 0.7), ("AP_R40_3D_mean", EVERY_IOU), ("mean_overlap", EVERY_IOU)]
    values = [reliable[one] for one in wanted]
    assert [row[-1] for row in table.rows] == [f"{value:.2f}" for value in values]
    assert len(set(values)) == 3
    assert len(table.data) == 4, "both IoUs"
    assert reliability_section(Analysis(run)) is None, "without halves"
    means = [seed_means(r.results, r.axes, r.left_out) for r in (run, together)]
    pd.testing.assert_frame_equal(*means)  # halves are no units of the jackknife
