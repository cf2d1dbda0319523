"""Surrogates of objects in a sweep: their stage, its place in the plan, and what ranks by them."""

import math

import numpy as np
import pandas as pd
import pytest

from lidarplace import PAPER_PLACEMENTS, ExpectedRecall, Placement
from lidarplace.logs.box_log import BoxLog, read_box_log
from lidarplace.pog.surrogates.table import OBJECT_SURROGATES, SURROGATES
from lidarplace.recall.detection_curve import DetectionCurve, write_curves
from sweeps.commands.run import app
from sweeps.configuration.grid import read_sweep
from sweeps.plan.plan import make_plan
from sweeps.stages.recall import RecallStage
from tests.lidarplace.recall.small_scenes import CURVES, LIDAR, MOUNTS, ROI, ROWS, cells_hit, log_of
from tests.mlflow_database import write_database
from tests.sweeps.small_log import write_sweep
from tests.sweeps.toy import call

SWEEP = {
    "detector": None,
    "classes": ["Car", "Cyclist"],
    "lidar": {"beams": 8, "azimuth_steps": 900, "cloud_share": 0.5},
    "grid": {"placement": ["line", "center", "pyramid"]},
}


def read(folder, **changes):
    path = write_sweep(folder, "small.yaml", **SWEEP | {"output": str(folder)} | changes)
    sweep = read_sweep(path)
    return path, sweep, make_plan(sweep)


@pytest.fixture
def log(tmp_path):
    write_database(tmp_path / "mlflow.db")
    return tmp_path


def curve(name, most):
    return DetectionCurve.model_validate({"class": name, "iou": 0.5, "most": most, "rate": 0.1})


def stage(rows, *rigs, classes=("Bus", "Tram")):
    """The stage's values by class and surrogate; frame 3 is one of testing."""
    log = log_of(*rows)
    log.frames["split"] = np.where(log.frames["frame"] == 3, "test", "train")
    curves = CURVES.model_copy(update={"curves": (*CURVES.curves, curve("Car", 0.9))})
    recall = RecallStage(rigs, OBJECT_SURROGATES, ROI, classes, curves, seed=0, frames=99)
    table = recall.run(log).table
    assert set(table["method"]) <= {"raycast"}
    return table.set_index(["class", "surrogate"])["value"]


def test_the_stage_counts_what_plain_python_counts():
    found = stage(ROWS, Placement("rig", MOUNTS, lidar=LIDAR), classes=("Tram", "Car", "Bus"))
    boxes = [[row[2], row[3], row[6] / 2, *row[4:]] for row in ROWS[:4]]
    cells, points = cells_hit(boxes, MOUNTS, LIDAR, 0.3, ROI)
    for name, most, rate in (("Tram", 0.9, 0.05), ("Bus", 0.7, 0.2)):
        of = [n for n, row in enumerate(ROWS[:4]) if row[1] == name]
        seen, hits = [len(cells[n]) for n in of], [points[n] for n in of]
        wanted = {
            "expected_recall": np.mean([most * (1 - math.exp(-rate * c)) for c in seen]),
            "log_cells": np.mean([math.log(1 + c) for c in seen]),
            "log_points": np.mean([math.log(1 + p) for p in hits]),
            "enough_points": np.mean([p >= 5 for p in hits]),
        }
        assert found[name].to_dict() == pytest.approx(wanted, rel=1e-12)
    assert set(found.index.get_level_values("class")) == {"Tram", "Bus"}, "there is no Car"


def test_a_log_without_objects_has_no_rows():
    assert stage(ROWS, Placement("rig", MOUNTS, lidar=LIDAR), classes=("Car",)).empty


@pytest.mark.parametrize("name", OBJECT_SURROGATES)
def test_more_lidars_do_what_its_sense_says(name):
    rigs = [Placement("rig", MOUNTS[:n], lidar=LIDAR) for n in (1, 2, 3)]
    values = np.array([stage(ROWS, rig).xs(name, level="surrogate") for rig in rigs])
    assert np.all(np.diff(values, axis=0) * SURROGATES[name].sense >= 0)
    assert np.all(values[0] < values[2]) or name == "enough_points"


def test_it_is_of_the_rig_of_the_clouds(log):
    quirks = {**SWEEP["lidar"], "tilt_in_degrees": True}
    _, _, plan = read(log, detector="pointpillars_tiny", lidar=quirks)
    for trial in plan.trials:
        assert trial.recall.stage.rigs == (trial.collect_test[0].stage.placement,)
        assert trial.recall.stage.rigs[0].lidars[0].azimuth_steps == 450
        assert set(trial.surrogates.stage.names) & set(OBJECT_SURROGATES) == set()


def test_drawn_mounts_give_the_mean_over_vehicles(log):
    errors = {"offset": 0.01, "angle_deg": 0.5}
    surrogate = {"names": ["expected_recall"], "mount_draws": 3}
    _, _, plan = read(log, surrogate=surrogate, mounting_errors=errors)
    params, meant = plan.trials[0].recall.stage, PAPER_PLACEMENTS["line"]
    assert len(set(params.rigs)) == 3
    for rig in params.rigs:
        for own, mount in zip(rig.mounts, meant.mounts, strict=True):
            assert 0 < np.abs(own.position - mount.position).max() <= 0.01
    single = [stage(ROWS, Placement("rig", rig.mounts, lidar=LIDAR)) for rig in params.rigs]
    every = stage(ROWS, *(Placement("rig", rig.mounts, lidar=LIDAR) for rig in params.rigs))
    pd.testing.assert_series_equal(every, sum(single) / 3)


def test_who_asks_for_none_pays_for_none(log):
    _, _, plan = read(log, surrogate={"names": ["m_sog"]})
    wanted = {"scene", "pog", "surrogates", "accuracy", "sampling_error"}
    assert {task.stage.name for task in plan.tasks} == wanted
    assert [trial.recall for trial in plan.trials] == [None] * 3


def test_placements_are_promoted_by_it(log):
    names = {"names": ["expected_recall"], "accuracy": False, "sampling_error": False}
    promote = [{"by": "expected_recall", "class": "Car", "keep": 1}]
    path, sweep, _ = read(log, surrogate=names, promote=promote)
    call(app, path)
    assert "expected recall" in (log / "small/report.html").read_text(encoding="utf-8")
    boxes = read_box_log(log / "log")
    boxes = BoxLog(boxes.boxes, boxes.frames[boxes.frames["split"] == "train"], boxes.buildings)
    point = sweep.points[0].point
    model = ExpectedRecall.from_log(boxes, point.voxel_roi(), ["Car"], azimuth_share=0.5)
    wanted = {
        name: model.of(sweep.rigs.of(point, name)).iloc[0, 0] for name in SWEEP["grid"]["placement"]
    }
    kept = pd.read_parquet(log / "small/surrogates.parquet")
    assert set(kept["surrogate"]) == {"expected_recall"}
    assert set(kept["class"]) == {"Car"}, "there is no Cyclist"
    assert kept.set_index("placement")["value"].to_dict() == pytest.approx(wanted)
    promoted = pd.read_parquet(log / "small/promotions.parquet").set_index("placement")
    assert promoted["value"].to_dict() == pytest.approx(wanted)
    assert promoted["kept"].to_dict() == {n: wanted[n] == max(wanted.values()) for n in wanted}
    assert (promoted["seconds"] > 0).all()


def test_own_curves_are_another_task(log):
    own = log / "curves.json"
    before = read(log)[2].trials[0]
    keys = []
    for most in (0.9, 0.5):
        write_curves(own, "by hand", [curve("Car", most), curve("Cyclist", most)])
        trial = read(log, surrogate={"curves": str(own)})[2].trials[0]
        assert trial.recall.stage.curves.of("Car", 0.5).most == most
        keys.append(trial.recall.key)
    assert len({before.recall.key, *keys}) == 3
