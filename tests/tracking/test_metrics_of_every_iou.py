"""Metrics of no single IoU wherever metrics are read: report, summary, search, MLflow."""

import shutil

import numpy as np
import pandas as pd
import pytest

from lidarplace.metrics import EVERY_IOU, METRICS, RANKING
from sweeps.configuration.search import ObjectiveSettings
from sweeps.configuration.sweep import Rung
from sweeps.results.trial_results import headline_value
from sweeps.search.trials.by_detectors import weighted_value
from tracking.findings.ceiling import ceilings
from tracking.findings.summary import seed_means, summary_table
from tracking.kitti_iou import headline_iou, judged, judged_by_all
from tracking.mlflow.content import trial_metrics
from tracking.report.build import build_report
from tracking.report.comparison.build import build_comparison
from tracking.report.sections.reliability import reliability_section
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
        own = judged(run.results, run.results, name, "mean_overlap")
        assert len(own) == 2 * len(run.placements)
    shown = judged_by_all(run.results, run.results, "Car")
    assert set(zip(shown["metric"], shown["iou"], strict=True)) == {
        *((name, 0.7) for name in ("AP_R40_3D", "AP_R40_BEV", "recall")),
        *((name, EVERY_IOU) for name in LIKE),
    }


def test_their_intervals_allow_for_the_test_objects(run):
    means = seed_means(run.results, run.axes, run.left_out)
    for name, old in LIKE.items():
        new = judged(means, run.results, "Car", name)
        same = means[(means["class"] == "Car") & (means["metric"] == old) & (means["iou"] == 0.5)]
        for column in ("mean", "sample_sd", "low", "high", "half"):
            assert np.isfinite(new[column]).all()
            assert new[column].tolist() == pytest.approx(same[column].tolist())


def test_the_summary_has_them_of_the_first_class(run):
    columns = list(summary_table(run).columns)
    assert [name for name in columns if "overlap" in name or "0.3" in name] == [
        "Car 3D@0.3–0.8",
        "Car overlap",
    ]
    assert not [name for name in columns if name.endswith("@0")]


def test_report_and_comparison_name_them_without_an_iou(folder, made_up_run, tmp_path):
    other = shutil.copytree(folder, tmp_path / "other")
    pages = [build_report(folder), build_comparison([folder, other], tmp_path / "both")]
    for page in pages:
        text = page.read_text(encoding="utf-8")
        assert "Car · 3D AP @ 0.3–0.8 (%)" in text
        assert "All objects · mean overlap (%)" in text or "all objects · mean overlap" in text
        assert "@ 0 " not in text
        assert "@ 0<" not in text


def test_rungs_and_objectives_may_ask_for_them():
    assert set(LIKE) <= set(RANKING)
    Rung.model_validate({"by": "mean_overlap", "keep": 1, "set": {"training.epochs": 1}})
    metrics = pd.DataFrame(
        [
            ("Car", "AP_R40_3D", 0.7, 20.0),
            ("Car", "AP_R40_3D_mean", EVERY_IOU, 50.0),
            ("Cyclist", "AP_R40_3D_mean", EVERY_IOU, 30.0),
            ("Car", "mean_overlap", EVERY_IOU, 61.0),
            ("all", "mean_overlap", EVERY_IOU, 60.0),
        ],
        columns=["class", "metric", "iou", "value"],
    )
    assert headline_value(metrics, "AP_R40_3D_mean", "Car") == 50
    for by, value in (("AP_R40_3D_mean", 40), ("mean_overlap", 60)):
        asked = ObjectiveSettings.model_validate({"by": by, "judge": "generalist"})
        assert asked.measured
        assert asked.best == "maximize"
        assert weighted_value(asked, ["Car", "Cyclist"], metrics) == value
    of_car = ObjectiveSettings.model_validate({"by": "mean_overlap", "weights": {"Car": 1.0}})
    assert weighted_value(of_car, ["Car", "Cyclist"], metrics) == 61


def test_mlflow_has_them_by_metric_and_class():
    rows = [("AP_R40_3D", "Car", 0.7, 20.0), ("mean_overlap", "all", EVERY_IOU, 60.0)]
    results = pd.DataFrame(rows, columns=["metric", "class", "iou", "value"])
    none = pd.DataFrame(columns=["surrogate", "class", "value"])
    assert trial_metrics(results, none) == {"AP_R40_3D.Car.0.70": 20.0, "mean_overlap.all": 60.0}


def test_the_report_tells_how_reliable_each_metric_is(run):
    """By hand: the jackknife's variance of paired differences by that of the means."""
    rng = np.random.default_rng(0)
    noise = 0.3 * rng.standard_normal(len(run.left_out))
    left_out = run.left_out.assign(value=run.left_out["value"] + noise)
    section = reliability_section(run, ceilings(run.results, left_out, run.axes))
    (table,) = section.tables
    rows = {(row[0], row[2]): row for row in table.rows}
    of_car = {"3D AP @ 0.7": 0.7, "BEV AP @ 0.7": 0.7, "recall @ 0.7": 0.7}
    of_car |= {"3D AP @ 0.3–0.8": EVERY_IOU, "mean overlap": EVERY_IOU}
    order = ["3D AP @ 0.7", "BEV AP @ 0.7", "3D AP @ 0.3–0.8", "recall @ 0.7", "mean overlap"]
    assert [metric for name, metric in rows if name == "Car"] == order
    reliable = {}
    for label, iou in of_car.items():
        metric = next(name for name in METRICS if METRICS[name].label in label.split(" @ 0.7"))
        one = (run.results["class"] == "Car") & (run.results["metric"] == metric)
        means = run.results[one & (run.results["iou"] == iou)].groupby("placement")["value"].mean()
        own = left_out[(left_out["class"] == "Car") & (left_out["metric"] == metric)]
        own = own[own["iou"] == iou]
        variances = []
        for _, unit in own.groupby("unit"):
            wide = unit.pivot_table("value", "left_out", "placement").to_numpy()
            paired = wide - wide.mean(axis=1, keepdims=True)
            squares = ((paired - paired.mean(axis=0)) ** 2).sum()
            variances.append((len(wide) - 1) / len(wide) * squares / (wide.shape[1] - 1))
        reliable[label] = 1 - max(variances) / means.var()
        assert rows["Car", label][6] == f"{reliable[label]:.2f}"
    assert len({f"{value:.2f}" for value in reliable.values()}) > 2, "not all 1"
    best = max(reliable, key=reliable.get)
    (told,) = (note for note in section.notes if note.startswith("Car: "))
    assert told.startswith(f"Car: {best} is most reliable, {reliable[best]:.2f}")
    assert reliability_section(run, ceilings(run.results, None, run.axes)) is None
