"""`lidarplace evaluate`: what counts, what is printed, and the run folder of several rigs."""

import json
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from lidarplace.clouds.visibility import ground_truth
from lidarplace.logs.box_log import write_box_log
from sweeps.command_line import app
from tests.lidarplace.test_detections import log_of, scored, write
from tests.sweeps.toy import call
from tracking.run_folders.sweep import RunFolder
from training.kitti_ap import evaluation

ROI = (0.0, 40.0, -20.0, 20.0, 0.0, 4.0)


def log_with_individuals(frames=60):
    log = log_of("parquet", frames)
    individuals = log.boxes["object_id"] + "in" + (log.boxes["frame"] // 5).astype(str)
    return replace(log, boxes=log.boxes.assign(object_id=individuals))


def jittered(boxes, seed, share=0.8, sd=0.15):
    random = np.random.default_rng(seed)
    detected = scored(boxes[random.uniform(size=len(boxes)) < share])
    detected[[*"xy"]] += random.normal(0, sd, (len(detected), 2))
    return detected


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    folder = tmp_path_factory.mktemp("world")
    log = log_with_individuals()
    write_box_log(folder / "log", log)
    write("parquet", folder / "labels", log, scored(log.boxes))
    for n, name in enumerate("ab"):
        write("parquet", folder / name, log, jittered(log.boxes, n, 0.9 - 0.2 * n, 0.1))
    return folder


def run(world, *arguments, code=0):
    return call(app, "evaluate", world / "log", *arguments, code=code).output


def test_labels_fed_back_are_perfect(world):
    rows = json.loads(run(world, world / "labels.parquet", "--json"))
    values = [row["mean"] for row in rows if row["metric"] != "mean_overlap"]
    assert set(values) == {100.0}
    assert len(values) > 20


def test_jittered_ones_are_worth_what_kitti_ap_says(world):
    log = log_with_individuals()
    rows = json.loads(run(world, world / "a.parquet", "--json"))
    objects = ground_truth(log, ROI[:2], ROI[2:4], ROI[4:])
    frames = log.frames["frame"].tolist()
    detections = pd.read_parquet(world / "a.parquet")
    direct = evaluation(objects, detections, frames, sorted(log.boxes["class"].unique()))
    keys = ["class", "metric", "iou"]
    means = pd.DataFrame(rows).set_index(keys)["mean"]
    pd.testing.assert_series_equal(
        means.sort_index(), direct.metrics.set_index(keys)["value"].sort_index(), check_names=False
    )


def test_what_does_not_count_is_neither_hit_nor_alarm(world, tmp_path):
    log = log_with_individuals()
    near = log.boxes[log.boxes["x"] < 15]  # the others are in the log, outside the ROI
    far = scored(log.boxes[log.boxes["x"] > 20])
    nothing = far.assign(x=100.0)
    write("parquet", tmp_path / "found", log, pd.concat([scored(near), far, nothing]))
    output = run(world, tmp_path / "found.parquet", "--roi", 0, 15, -20, 20, 0, 4, "--json")
    values = {row["metric"]: row["mean"] for row in json.loads(output) if row["class"] == "Car"}
    assert values["AP_R40_3D"] == values["class_recall_3D"] == 100
    text = run(world, tmp_path / "found.parquet", "--roi", 0, 15, -20, 20, 0, 4)
    assert f"detections: {len(near):,} of {len(near) + 2 * len(far):,} detections count" in text
    (car,) = (line for line in text.splitlines() if line.startswith("Car"))
    intervals = re.findall(r"100\.0 \(([0-9.]+) to 100\.0\)", car)
    assert len(intervals) == 4, "all that few individuals show is no certainty"
    assert all(50 < float(low) < 99 for low in intervals)


def test_one_rig_is_a_table_with_intervals(world):
    lines = run(world, world / "a.parquet").splitlines()
    assert lines[0].endswith(
        "in the ROI and visible to an ideal sensor on the roof, as in a sweep."
    )
    (car,) = (line.split("  ") for line in lines if line.startswith("Car"))
    assert " to " in car[-1]
    assert lines[-1].startswith(f"next: compare rigs: lidarplace evaluate {world / 'log'} --rig ")
    assert not (world / "runs").exists()


def test_rigs_become_a_run_folder(world, tmp_path):
    (tmp_path / "rig.yaml").write_text("mounts: [{x: 0.5, y: 0, z: 2}]\n")
    rigs = [f"--rig={name}={world / name}.parquet" for name in "ab"]
    again = [f"--rig={name}={world}/labels.parquet" for name in "ab"]
    places = [f"--geometry={name}={tmp_path / 'rig.yaml'}" for name in "ab"]
    out = tmp_path / "runs" / "two"
    (tmp_path / "body.yaml").write_text("[[[-1, -1, 0], [3, 1, 2]]]")
    vehicle = ["--vehicle", tmp_path / "body.yaml"]
    text = run(world, *rigs, *again, *places, *vehicle, "--generalist", "--out", out)
    assert f"lidarplace calibrate --log {world / 'log'}" in text.splitlines()[-1]
    for page in ("report.html", "decision.html", "failures.html"):
        assert (out / page).exists()
    assert str(out / "decision.html") in text.splitlines()
    run_folder = RunFolder.read(out)
    assert run_folder.sweep.detections == {
        name: (f"{world / name}.parquet", f"{world}/labels.parquet") for name in "ab"
    }
    assert sorted(run_folder.trials["trial"]) == ["a/0", "a/1", "b/0", "b/1"]
    assert run_folder.failures is not None
    assert run_folder.placements["a"][0].x == 0.5
    assert run_folder.sweep.body.boxes.tolist() == [[[-1, -1, 0], [3, 1, 2]]]
    decision = (out / "decision.html").read_text()
    assert "Where the LiDARs sit" in decision
    assert "MLflow" not in decision
    assert "--set" not in text  # no command of ours trains these detectors
    call(app, "failures", out, "--out", tmp_path / "failures")
    page = (tmp_path / "failures" / "failures.html").read_text()
    assert "nan" not in page.lower().split("<script")[0]
    # A sweep is not overwritten.
    about = json.loads((out / "sweep.json").read_text())
    del about["detections"]
    (out / "sweep.json").write_text(json.dumps(about))
    text = run(world, *rigs, "--out", out, code=2)
    assert text == f"{out}: is the run folder of a sweep; name another one with --out\n"


def test_an_implausible_convention_is_refused_unless_accepted(world, tmp_path):
    log = log_with_individuals()
    mirrored = jittered(log.boxes, 0, sd=0.05).assign(y=lambda d: -d["y"], score=50.0)
    path = write("parquet", tmp_path / "found", log, mirrored)
    rig = (tmp_path / "rig.yaml").write_text("mounts: [{x: 0.5, y: 0, z: 2}]\n") and "rig.yaml"
    options = ["--log", world / "log", f"--rig=a={path}", f"--geometry=a={tmp_path / rig}"]
    output = call(app, "calibrate", *options, code=2).output
    assert output == run(world, path, code=2)
    assert output.startswith(f"{path}: column y: detections fit the labels with y mirrored: median")
    assert output.endswith("; convert them, or accept the values: --accept place\n")
    output = run(world, path, "--accept", "place")
    assert f"warning: {path}: column score: scores are from 50 to 50, as percent are" in output
    assert "warning" not in run(world, path, "--accept", "place", "--accept", "score")


def test_a_class_without_objects_has_no_ap(world):
    region = ["--roi", 5, 7, -20, 20, 0, 4]
    output = run(world, world / "a.parquet", *region, "--class", "Car", "--class", "Pedestrian")
    assert "no AP, no recall: no object of Pedestrian counts in these frames" in output
    assert "of 0 objects" not in output


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["{a}", "--split", "train"], "--split: no frame of the split; expected train, found test"),
        (["{a}", "--geometry", "b=recorded"], "--geometry b=recorded: no rig, or a second"),
        (["{a}", "--geometry", "detections=recorded"], "no recorded rig; convert the log with"),
    ],
)
def test_mistakes_are_one_line(world, arguments, expected):
    words = [each.format(a=world / "a.parquet") for each in arguments]
    text = run(world, *words, code=2)
    assert text.startswith(expected)
    assert len(text.splitlines()) == 1
