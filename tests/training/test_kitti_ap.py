"""AP and recall: by hand, against a plain implementation, and against the official evaluation.

tests/data/training_kitti_eval.npz: 50 synthetic frames of KITTI labels and what OpenPCDet's copy of
the KITTI evaluation (commit 8cacccec, Apache-2.0) gives for them: arrays "<run>/<metric>/<AP>" of
shape (class, difficulty, overlap row). Runs: upstream; paper_fork_no_min_height, the same without
the rule of minimum height; uniform_0.7_0.5, the same overlap for all classes.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from lidarplace.boxes import GEOMETRY
from training.average_precision import COUNTS, IGNORED, OTHER, FramePairs, ap_r40, precision_curve
from training.kitti_ap import evaluate_boxes, evaluate_detections
from training.kitti_labels import DIFFICULTIES

DATA = Path(__file__).parents[1] / "data" / "training_kitti_eval.npz"
CLASSES = ("Car", "Pedestrian", "Cyclist")
STRICT = {"Car": 0.7, "Pedestrian": 0.5, "Cyclist": 0.5}


def labels(data, side):
    table = {
        name: data[f"{side}_{key}"]
        for name, key in (("frame", "frame"), ("class", "name"), ("truncated", "truncated"),
                          ("occluded", "occluded"), ("alpha", "alpha"))
    }  # fmt: skip
    for i, name in enumerate(("left", "top", "right", "bottom")):
        table[name] = data[f"{side}_bbox"][:, i]
    for i, name in enumerate(("length", "height", "width")):
        table[name] = data[f"{side}_dimensions"][:, i]
    for i, name in enumerate("xyz"):
        table[name] = data[f"{side}_location"][:, i]
    table["rotation_y"] = data[f"{side}_rotation_y"]
    if side == "dt":
        table["score"] = data["dt_score"]
    return pd.DataFrame(table)


@pytest.mark.parametrize(
    ("run", "row", "iou", "min_height"),
    [
        ("upstream", 0, STRICT, True),
        ("paper_fork_no_min_height", 0, STRICT, False),
        ("uniform_0.7_0.5", 0, dict.fromkeys(CLASSES, 0.7), True),
        ("uniform_0.7_0.5", 1, dict.fromkeys(CLASSES, 0.5), True),
    ],
)
def test_agrees_with_the_official_evaluation(run, row, iou, min_height):
    data = np.load(DATA)
    table = evaluate_detections(labels(data, "gt"), labels(data, "dt"), 50, iou, min_height)
    value = table.set_index(["class", "metric", "difficulty"])["value"]
    for metric, theirs in (("3D", "3d"), ("BEV", "bev"), ("image", "bbox")):
        for points in ("AP_R40", "AP_R11"):
            expected = data[f"{run}/{theirs}/{points}"]
            for c, name in enumerate(CLASSES):
                for d, difficulty in enumerate(DIFFICULTIES):
                    assert value[name, f"{points}_{metric}", difficulty] == pytest.approx(
                        expected[c, d, row], abs=1e-9
                    )
    assert 0 < value["Car", "AP_R40_3D", "moderate"] < 90


def test_official_table_says_what_counts_and_refuses_bad_labels():
    data = np.load(DATA)
    truth, found = labels(data, "gt"), labels(data, "dt")
    table = evaluate_detections(truth, found, 50, {"Car": 0.7})
    recall = table[table.metric == "recall"].iloc[0]
    assert (recall.difficulty, recall.ground_truths) == ("all", (truth["class"] == "Car").sum())
    hard = table[(table.metric == "AP_R40_3D") & (table.difficulty == "hard")].iloc[0]
    assert 0 < hard.ground_truths < recall.ground_truths
    empty = evaluate_detections(truth[truth["class"] != "Car"], found, 50, {"Car": 0.7})
    assert (empty.value == 0).all()
    with pytest.raises(ValueError, match="ground truth: no column occluded"):
        evaluate_detections(truth.drop(columns="occluded"), found, 50, STRICT)
    found.loc[3, "x"] = np.nan
    with pytest.raises(ValueError, match="detections: row 3"):
        evaluate_detections(truth, found, 50, STRICT)


def plain_curve(frames, minimum):
    """The definition in plain Python: per frame (overlaps [gt][dt], scores, gt roles, dt roles)."""

    def match(overlaps, scores, truth_role, found_role, lowest, by_score):
        taken, hits = set(), []
        for g, role in enumerate(truth_role):
            fits = [
                d
                for d in range(len(scores))
                if d not in taken and found_role[d] != OTHER and scores[d] >= lowest
                and overlaps[g][d] > minimum
            ]  # fmt: skip
            if role == OTHER or not fits:
                continue
            if by_score:
                best = max(fits, key=lambda d: (scores[d], -d))
            else:
                counting = [d for d in fits if found_role[d] == COUNTS]
                best = max(counting, key=lambda d: (overlaps[g][d], -d)) if counting else fits[0]
            taken.add(best)
            if role == COUNTS and found_role[best] == COUNTS:
                hits.append(scores[best])
        alarms = [
            d for d in range(len(scores))
            if d not in taken and found_role[d] == COUNTS and scores[d] >= lowest
        ]  # fmt: skip
        return hits, len(alarms)

    scores = sorted((s for f in frames for s in match(*f, -np.inf, True)[0]), reverse=True)
    total = sum(role == COUNTS for f in frames for role in f[2])
    sampled, recall = [], 0.0
    for i, score in enumerate(scores):
        last = i == len(scores) - 1
        if not last and (i + 2) / total - recall < recall - (i + 1) / total:
            continue
        sampled.append(score)
        recall += 1 / 40
    curve = np.zeros(41)
    for t, score in enumerate(sampled):
        matched = [match(*f, score, False) for f in frames]
        hits, alarms = sum(len(h) for h, _ in matched), sum(a for _, a in matched)
        curve[t] = hits / (hits + alarms) if hits + alarms else 0.0
    return np.maximum.accumulate(curve[::-1])[::-1]


@pytest.mark.parametrize("seed", range(8))
def test_curve_agrees_with_the_definition(seed):
    random = np.random.default_rng(seed)
    frames = []
    for _ in range(30):
        truths, found = random.integers(0, 6), random.integers(0, 8)
        frames.append(
            (
                # Coarse values, so that ties of overlap and score happen.
                np.round(random.random((truths, found)), 1),
                np.round(random.random(found), 1),
                random.choice([COUNTS, COUNTS, IGNORED, OTHER], truths).astype(np.int8),
                random.choice([COUNTS, COUNTS, IGNORED, OTHER], found).astype(np.int8),
            )
        )
    pairs = FramePairs.of(
        np.repeat(np.arange(30), [len(f[2]) for f in frames]),
        np.repeat(np.arange(30), [len(f[1]) for f in frames]),
        30,
    )
    curve = precision_curve(
        pairs,
        np.concatenate([f[0].ravel() for f in frames]),
        np.concatenate([f[1] for f in frames]),
        0.5,
        np.concatenate([f[2] for f in frames]),
        np.concatenate([f[3] for f in frames]),
    )
    assert curve == pytest.approx(plain_curve(frames, 0.5), abs=1e-15)
    assert 0 < ap_r40(curve) < 100


def table(rows, score=False):
    columns = ["frame", "class", *GEOMETRY, *(["score"] if score else [])]
    return pd.DataFrame(rows, columns=columns).astype({"frame": np.int64})


def car(frame, x, name="Car", score=None):
    row = (frame, name, x, 0.0, 0.8, 4.0, 2.0, 1.6, 0.0)
    return row if score is None else (*row, score)


def values(result):
    return result.set_index(["class", "metric", "iou"])["value"]


def test_perfect_and_absent_detections():
    truth = table([car(f, x) for f in range(50) for x in (5.0, 15.0)])
    perfect = table([car(f, x, score=0.5) for f in range(50) for x in (5.0, 15.0)], score=True)
    result = evaluate_boxes(truth, perfect, range(50), ["Car"])
    assert (result.value == 100).all()
    assert list(result.columns) == [
        "class", "metric", "iou", "difficulty", "value", "ground_truths",
    ]  # fmt: skip
    assert (result.ground_truths == 100).all()
    assert set(result.difficulty) == {"all"}
    few = evaluate_boxes(truth, perfect, range(8), ["Car"])
    assert values(few)["Car", "AP_R40_BEV", 0.5] == pytest.approx(100 * 15 / 40)
    nothing = evaluate_boxes(truth, perfect[:0], range(50), ["Car"])
    assert (nothing.value == 0).all()


def test_ap_by_hand():
    # 40 cars, the 20 found have higher scores than 20 false alarms; precision 1 up to recall 1/2.
    truth = table([car(f, 5.0) for f in range(40)])
    found = [car(f, 5.0, score=0.9) for f in range(20)] + [
        car(f, 30.0, score=0.1) for f in range(20)
    ]
    result = values(evaluate_boxes(truth, table(found, score=True), range(40), ["Car"]))
    # KITTI's sampling reaches index 19 of 0 … 40 with 20 hits of 40, and index 0 is not averaged.
    assert result["Car", "AP_R40_3D", 0.7] == pytest.approx(100 * 19 / 40)
    assert result["Car", "recall", 0.7] == 50
    # With one score for all there is one working point: 20 hits and 20 false alarms.
    found = [(*row[:-1], 0.5) for row in found]
    result = values(evaluate_boxes(truth, table(found, score=True), range(40), ["Car"]))
    assert result["Car", "AP_R40_3D", 0.7] == pytest.approx(50 * 19 / 40)


def test_overlap_must_exceed_the_threshold():
    # 4 m long boxes 4/3 m apart share half of their union, up to a rounding in x.
    truth = table([car(0, 4.0)])
    for shift, hits in ((4 / 3 + 1e-9, 0), (4 / 3 - 1e-9, 100)):
        found = table([car(0, 4.0 + shift, score=0.5)], score=True)
        assert values(evaluate_boxes(truth, found, [0], ["Car"]))["Car", "recall", 0.5] == hits
    # Exactly a quarter: 1 m shared of 2.5 + 2.5 - 1.
    truth.loc[0, "length"] = 2.5
    found = table([car(0, 5.5, "Cyclist", 0.5)], score=True)
    found.loc[0, "length"] = 2.5
    truth["class"] = "Cyclist"
    result = values(evaluate_boxes(truth, found, [0], ["Cyclist"]))
    assert result["Cyclist", "AP_R40_BEV", 0.25] == 0


def test_recall_takes_any_class_and_ap_only_its_own():
    truth = table([car(0, 5.0), car(0, 15.0, "Cyclist")])
    found = table([car(0, 5.0, "Cyclist", 0.9)], score=True)
    result = values(evaluate_boxes(truth, found, [0], ["Car", "Cyclist", "Pedestrian"]))
    assert result["Car", "recall", 0.7] == 100
    assert result["Car", "AP_R40_3D", 0.7] == 0
    assert result["Cyclist", "recall", 0.5] == 0
    assert result["all", "recall", 0.5] == 50
    assert np.isnan(result["Pedestrian", "AP_R40_3D", 0.5])
    assert np.isnan(result["Pedestrian", "recall", 0.7])


def test_only_the_frames_asked_for_count_and_order_does_not_matter():
    truth = table([car(7, 5.0), car(3, 5.0), car(9, 5.0)])
    found = table([car(9, 5.0, score=0.2), car(3, 5.0, score=0.9)], score=True)
    result = evaluate_boxes(truth, found, [9, 7], ["Car"])
    assert (result.ground_truths == 2).all()
    assert (result[result.metric == "recall"].value == 50).all()
    turned = evaluate_boxes(truth[::-1], found[::-1], [7, 9], ["Car"])
    pd.testing.assert_frame_equal(result, turned)


def test_bad_tables():
    truth = table([car(0, 5.0)])
    found = table([car(0, 5.0, score=np.nan)], score=True)
    with pytest.raises(ValueError, match="needs a score, found NaN in 1 row"):
        evaluate_boxes(truth, found, [0], ["Car"])
    with pytest.raises(ValueError, match="no column score"):
        evaluate_boxes(truth, found.drop(columns="score"), [0], ["Car"])
    with pytest.raises(ValueError, match="detections: no column yaw"):
        evaluate_boxes(truth, found.drop(columns="yaw"), [0], ["Car"])
