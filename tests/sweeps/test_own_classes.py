"""Classes of one's own in a sweep: from a log to AP, and what is said of those that are missing."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from lidarplace.logs.box_log import BoxLog, read_box_log, write_box_log
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.pog.surrogates.table import ASKED_FOR
from lidarplace.scenes.recorded import LogScene
from sweeps.configuration.grid import build_sweep
from sweeps.plan.plan import make_plan
from tests.forked import run_forked
from tests.mlflow_database import write_database
from tests.refused import refused
from tests.sweeps.small_log import SMALL, write_sweep
from training.checkpoints import write_checkpoint
from training.typical_objects import typical_objects

CLASSES = ("Car", "Truck", "Scooter", "Pedestrian")
SIZES = {"Car": (4.4, 1.8, 1.6), "Truck": (7.5, 2.5, 3.2)}
SIZES |= {"Scooter": (1.8, 0.7, 1.4), "Pedestrian": (0.6, 0.6, 1.75)}


def write_four_classes(folder: Path, frames: int = 4, routes: int = 4, seed: int = 0) -> BoxLog:
    """Routes of so many frames, the last two of which are test; two objects of a class in each."""
    random = np.random.default_rng(seed)
    rows = []
    for route in range(routes):
        for index, name in enumerate(CLASSES * 2):
            length, width, height = np.array(SIZES[name]) * random.uniform(0.9, 1.1)
            x, y = 4 + 4 * index, random.uniform(-6, 6)
            for k in range(frames):
                pose = (x + 0.4 * k, y, height / 2, length, width, height, 0.0)
                frame = route * frames + k
                rows.append((f"r{route}", frame, frame / 2, f"{name}-{route}-{index}", name, *pose))
    names = ["scene", "frame", "timestamp_s", "object_id", "class", *GEOMETRY]
    number = np.arange(routes * frames)
    route = number // frames
    split = np.where(route < routes - 2, "train", "test")
    table = pd.DataFrame({"frame": number, "timestamp_s": number / 2, "route": route})
    table = table.assign(scene=[f"r{own}" for own in route], split=split)
    log = BoxLog(pd.DataFrame(rows, columns=names), table)
    write_box_log(folder, log)
    return log


ROOT = Path(__file__).parents[2]
WITHOUT_CURVES = [name for name in ASKED_FOR if name != "expected_recall"]


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    folder = tmp_path_factory.mktemp("four") / "log"
    write_four_classes(folder)
    return folder


def plan_of(log, tmp_path, **changes):
    scene = {"source": "log", "folder": str(log)} | changes.pop("scene", {})
    config = {"name": "own", "scene": scene, "classes": list(CLASSES), "placement": "line"}
    config["surrogate"] = {"names": WITHOUT_CURVES, "resolution": 0.5}
    return make_plan(build_sweep(config | changes, tmp_path / "own.yaml"))


def test_anchors_are_those_of_the_training_frames(log, tmp_path):
    own = read_box_log(log)
    train = own.frames.loc[own.frames["split"] == "train", "frame"]
    boxes = own.boxes[own.boxes["frame"].isin(train)]
    plan = plan_of(log, tmp_path)
    assert plan.typical == typical_objects(boxes, ["Truck", "Scooter"])
    for item in plan.typical:  # by pandas alone
        first = boxes[boxes["class"] == item.name].drop_duplicates("object_id")
        assert item.size == pytest.approx(
            first[["length", "width", "height"]].mean().tolist(), abs=5e-4
        )
    fixed = plan_of(log, tmp_path, class_settings={"Car": {"size": [5, 2, 1.5]}})
    assert [item.name for item in fixed.typical] == ["Car", "Truck", "Scooter"]
    assert fixed.typical[0].size == (5, 2, 1.5)


def test_only_what_judges_depends_on_the_overlaps(log, tmp_path):
    plain_plan = plan_of(log, tmp_path)
    other = plan_of(
        log, tmp_path, class_settings={"Truck": {"iou": [0.7, 0.5], "colour": "#112233"}}
    )
    mine, its = plain_plan.trials[0], other.trials[0]
    assert mine.finetune.key == its.finetune.key
    assert mine.evaluate.key != its.evaluate.key
    assert its.evaluate.stage.ious == (("Truck", (0.7, 0.5)),)


def test_a_class_of_test_frames_alone(log, tmp_path):
    own = read_box_log(log)
    tests = own.frames.loc[own.frames["split"] == "test", "frame"]
    gone = (own.boxes["class"] == "Truck") & ~own.boxes["frame"].isin(tests)
    write_box_log(tmp_path / "log", BoxLog(own.boxes[~gone], own.frames))
    with refused(("", "classes", ""), "log: Truck has 16 boxes in the test frames"):
        plan_of(tmp_path / "log", tmp_path)
    # Of KITTI's three some may be missing, and the others go on.
    three = plan_of(tmp_path / "log", tmp_path, classes=["Car", "Cyclist", "Pedestrian"])
    (said,) = three.cautions
    assert said.startswith("log: no box of class Cyclist in the training frames; found Car (")


def test_a_curve_that_is_lent(log, tmp_path):
    lent = {"Truck": {"curve": "Car"}, "Scooter": {"curve": "Cyclist"}}
    surrogate = {"names": ["expected_recall"]}
    with refused(("", "surrogate.curves", ""), "class_settings.Truck.curve"):
        plan_of(log, tmp_path, surrogate=surrogate)
    with refused(("", "surrogate.curves", ""), "found Tram"):
        plan_of(log, tmp_path, class_settings={"Truck": {"curve": "Tram"}}, surrogate={})
    plan = plan_of(log, tmp_path, class_settings=lent, surrogate=surrogate)
    curves = plan.trials[0].recall.stage.curves
    assert curves.of("Truck", 0.5).rate == curves.of("Car", 0.5).rate
    assert curves.of("Scooter", 0.5).most == curves.of("Cyclist", 0.5).most


def test_a_checkpoint_says_how_large_classes_are(log, tmp_path):
    from training import build_detector

    plan = plan_of(log, tmp_path)
    larger = [*plan.typical[:1], *plan_of(log, tmp_path).typical[1:]]
    larger[0] = type(larger[0])("Truck", (9.0, 2.5, 3.5), 0.0)
    crop = plan.trials[0].evaluate.stage.point_range
    model = build_detector("pointpillars_tiny", CLASSES, point_range=crop, typical=larger)
    path = tmp_path / "base.pt"
    write_checkpoint(path, model.state_dict(), "pointpillars_tiny", CLASSES, model.typical)
    training = {"checkpoint": str(path)}
    assert plan_of(log, tmp_path, training=training).typical == tuple(larger)
    with refused(("", "training.checkpoint", ""), "Truck 9.00 × "):
        plan_of(log, tmp_path, training=training, class_settings={"Truck": {"size": [8, 2.5, 3]}})


def test_classes_of_a_log_that_count_as_others(log, tmp_path):
    before = read_box_log(log).boxes["class"].value_counts()
    own = {"Truck": "Car", "Scooter": "ignore"}
    found = LogScene(source="log", folder=log, class_map=own).read().boxes["class"].value_counts()
    cars = before["Car"] + before["Truck"]
    assert found.to_dict() == {"Car": cars, "Pedestrian": before["Pedestrian"]}
    paper = LogScene(source="log", folder=log, class_map="paper").read().boxes["class"]
    assert paper.value_counts()["Cyclist"] == before["Truck"]
    plans = [
        plan_of(log, tmp_path, classes=["Car"], scene=scene) for scene in ({}, {"class_map": own})
    ]
    assert len({plan.trials[0].pog.key for plan in plans}) == 2


def test_from_a_log_to_a_decision(log, tmp_path):
    names = {"names": ["covered_entropy", "log_cells"], "resolution": 1.0}
    keys = {"classes": ["Car", "Truck", "Scooter", "Pedestrian"], "lidar": {"cloud_share": 0.04}}
    keys |= {"class_settings": {"Truck": {"iou": [0.7, 0.5], "colour": "#CC79A7"}}}
    keys |= {"surrogate": SMALL["surrogate"] | names, "grid": {"placement": ["line", "center"]}}
    keys |= {"training": {"epochs": 1, "frame_share": 0.5}}
    config = write_sweep(log.parent, "own.yaml", **keys, output=str(tmp_path / "runs"))
    write_database(tmp_path / "runs" / "mlflow.db")
    done = run_forked(["run", str(config)], ROOT, tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "anchors of Truck " in done.stdout
    run = tmp_path / "runs" / "own"
    results = pd.read_parquet(run / "results.parquet")
    ap = results[results["metric"] == "AP_R40_3D"].groupby("class")["iou"].apply(set).to_dict()
    strict, loose = {0.7, 0.5}, {0.5, 0.25}
    assert ap == {"Car": strict, "Truck": strict, "Scooter": loose, "Pedestrian": loose}
    surrogates = pd.read_parquet(run / "surrogates.parquet")
    assert set(surrogates["class"]) >= set(SIZES)
    kept = json.loads((run / "sweep.json").read_text())
    assert [own["name"] for own in kept["anchors"]] == ["Truck", "Scooter"]
    assert "3D AP @ 0.7, Truck" in (run / "decision.html").read_text()
    assert "#CC79A7" in (run / "report.html").read_text()
