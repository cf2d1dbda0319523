"""AP and recall: by hand, against a plain implementation, and against the official evaluation.

tests/data/training_kitti_eval.npz: 50 synthetic frames of KITTI labels and what OpenPCDet's copy of
the KITTI evaluation (commit 8cacccec, Apache-2.0) gives for them: arrays "<run>/<metric>/<AP>" of
shape (class, difficulty, overlap row). Runs: upstream, of strict and loose overlap (image boxes:
strict in both); paper_fork_no_min_height, the same without the rule of minimum height; uniform_…,
the same overlap for all classes, 0.7 and 0.5. Metric aos: average orientation similarity.
"""

import math
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from lidarplace.logs.boxes import GEOMETRY
from tests.refused import refused
from tests.training.plain_curve import plain_curve
from training.average_precision import (
    COUNTS,
    IGNORED,
    OTHER,
    FramePairs,
    Roles,
    ap_r40,
    precision_curve,
)
from training.kitti_ap import COLUMNS, evaluate_boxes, evaluate_detections, found_objects
from training.kitti_labels import DIFFICULTIES

DATA = Path(__file__).parents[1] / "data" / "training_kitti_eval.npz"
CLASSES = ("Car", "Pedestrian", "Cyclist")
STRICT = {"Car": 0.7, "Pedestrian": 0.5, "Cyclist": 0.5}
LOOSE = {"Car": 0.5, "Pedestrian": 0.25, "Cyclist": 0.25}
OFFICIAL = {"AP_{}_3D": "3d", "AP_{}_BEV": "bev", "AP_{}_image": "bbox", "AOS_{}": "aos"}


def labels(data, side):
    columns = {
        **dict.fromkeys(("frame", "truncated", "occluded", "alpha", "rotation_y")),
        "class": "name",
        **{name: ("bbox", i) for i, name in enumerate(("left", "top", "right", "bottom"))},
        **{name: ("dimensions", i) for i, name in enumerate(("length", "height", "width"))},
        **{name: ("location", i) for i, name in enumerate("xyz")},
        **({"score": "score"} if side == "dt" else {}),
    }
    table = {}
    for name, key in columns.items():
        key, *column = (key,) if isinstance(key, str) else key or (name,)
        table[name] = data[f"{side}_{key}"][(..., *column)]
    return pd.DataFrame(table)


@pytest.fixture(scope="module")
def truth():
    return labels(np.load(DATA), "gt")


@pytest.fixture(scope="module")
def detected():
    return labels(np.load(DATA), "dt")


@pytest.mark.parametrize(
    ("run", "row", "iou", "min_height", "compared"),
    [
        ("upstream", 0, STRICT, True, 72),
        ("upstream", 1, LOOSE, True, 36),
        ("paper_fork_no_min_height", 0, STRICT, False, 72),
        ("paper_fork_no_min_height", 1, LOOSE, False, 36),
        ("uniform_0.7_0.5", 0, dict.fromkeys(CLASSES, 0.7), True, 54),
        ("uniform_0.7_0.5", 1, dict.fromkeys(CLASSES, 0.5), True, 54),
        ("uniform_0.7_0.5_paper_fork", 0, dict.fromkeys(CLASSES, 0.7), False, 27),
        ("uniform_0.7_0.5_paper_fork", 1, dict.fromkeys(CLASSES, 0.5), False, 27),
    ],
)
def test_agrees_with_the_official_evaluation(truth, detected, run, row, iou, min_height, compared):
    """R40 of the strict rows of `upstream` are OpenPCDet's 36 keys."""
    data = np.load(DATA)
    table = evaluate_detections(truth, detected, 50, iou, min_height)
    value = table.set_index(["class", "metric", "difficulty"])["value"]
    ours, official = [], []
    for (metric, theirs), points in product(OFFICIAL.items(), ("R40", "R11")):
        key = f"{run}/{theirs}/AP_{points}"
        if key in data and not (iou == LOOSE and theirs in ("bbox", "aos")):
            official += data[key][:, :, row].ravel().tolist()
            places = product(CLASSES, [metric.format(points)], DIFFICULTIES)
            ours += [value[place] for place in places]
    assert ours == pytest.approx(official, abs=1e-9)
    assert len(ours) == compared
    assert 0 < value["Car", "AP_R40_3D", "moderate"] < 90


def test_official_table_says_what_counts_and_refuses_bad_labels(truth, detected):
    table = evaluate_detections(truth, detected, 50, {"Car": 0.7})
    recall = table[table.metric == "recall"].iloc[0]
    assert (recall.difficulty, recall.ground_truths) == ("all", (truth["class"] == "Car").sum())
    hard = table[(table.metric == "AP_R40_3D") & (table.difficulty == "hard")].iloc[0]
    assert 0 < hard.ground_truths < recall.ground_truths
    empty = evaluate_detections(truth[truth["class"] != "Car"], detected, 50, {"Car": 0.7})
    assert (empty.value == 0).all()
    with refused(("ground truth", "occluded", "")):
        evaluate_detections(truth.drop(columns="occluded"), detected, 50, STRICT)
    for column, bad in (("x", np.nan), ("score", np.nan), ("score", np.inf)):
        for name in ("Car", "DontCare"):
            wrong = detected.astype({"class": object})
            wrong.loc[3, [column, "class"]] = bad, name
            if (column, name) != ("x", "DontCare"):
                with refused(("detections: row 3", "", "")):
                    evaluate_detections(truth, wrong, 50, STRICT)


def official_values(truth, detected, frames=50, **settings):
    table = evaluate_detections(truth, detected, frames, STRICT, **settings)
    return table.set_index(["class", "metric", "difficulty"])["value"]


def test_nothing_to_find_and_nothing_found(truth, detected):
    for nothing in (truth[:0], pd.DataFrame(columns=truth.columns)):
        assert (official_values(nothing, detected) == 0).all()
    for nothing in (detected[:0], pd.DataFrame(columns=detected.columns)):
        assert (official_values(truth, nothing) == 0).all()
    assert (official_values(truth[:0], detected[:0], 0) == 0).all()
    # Frames that are empty change nothing, wherever they stand.
    spread = [table.assign(frame=3 * table["frame"] + 7) for table in (truth, detected)]
    pd.testing.assert_series_equal(official_values(*spread, 170), official_values(truth, detected))


def test_order_within_a_frame_decides_only_ties_of_score(truth, detected):
    # Scores and overlaps have many ties in these frames; without ties of score, no order matters.
    random = np.random.default_rng(0)
    detected = detected.assign(score=random.permutation(len(detected)) / len(detected))
    shuffled = detected.sample(frac=1, random_state=0)
    pd.testing.assert_series_equal(
        official_values(truth, shuffled), official_values(truth, detected)
    )


def test_an_unknown_alpha_leaves_orientation_out(truth, detected):
    without = official_values(truth, detected.assign(alpha=-10.0))
    names = without.index.get_level_values("metric")
    assert not names.str.startswith("AOS").any()
    pd.testing.assert_series_equal(without, official_values(truth, detected)[without.index])


def test_dont_care_excuses_image_boxes_only(truth, detected):
    truth = truth[truth["class"] != "DontCare"]
    alarms = detected.assign(frame=detected["frame"] + 50)  # in frames with nothing in them
    region = truth[:1].assign(**{"class": "DontCare"}, left=-1e4, top=-1e4, right=1e4, bottom=1e4)
    numbers = ["truncated", "occluded", "x", "y", "z", "length", "width", "height", "rotation_y"]
    region[numbers] = np.nan  # a region is in the image only
    regions = pd.concat([region.assign(frame=frame) for frame in range(50, 100)])
    plain = official_values(truth, detected, 100)
    worse = official_values(truth, pd.concat([detected, alarms]), 100)
    excused = official_values(pd.concat([truth, regions]), pd.concat([detected, alarms]), 100)
    for view in ("3D", "BEV", "image"):
        key = ("Car", f"AP_R40_{view}", "moderate")
        assert worse[key] < plain[key]
    image = plain.index.get_level_values("metric").str.contains("image|AOS")
    pd.testing.assert_series_equal(excused[image], plain[image])
    pd.testing.assert_series_equal(excused[~image], worse[~image])


@pytest.mark.parametrize("seed", range(8))
def test_curve_agrees_with_the_definition(seed):
    random = np.random.default_rng(seed)
    frames = []
    for _ in range(30):
        truths, detected = random.integers(0, 6), random.integers(0, 8)
        # Coarse values, so that ties of overlap and score happen.
        overlaps = np.round(random.random((truths, detected)), 1)
        scores = np.round(random.random(detected), 1)
        kinds = [COUNTS, COUNTS, IGNORED, OTHER]
        roles = (random.choice(kinds, count).astype(np.int8) for count in (truths, detected))
        frames.append((overlaps, scores, *roles))
    counts = ([len(frame[k]) for frame in frames] for k in (2, 1))
    pairs = FramePairs.of(*(np.repeat(np.arange(30), count) for count in counts), 30)
    parts = zip(*frames, strict=True)
    overlaps, scores, *roles = (np.concatenate([array.ravel() for array in part]) for part in parts)
    harmless, alike = np.zeros(len(scores), bool), np.ones(len(overlaps))
    curve = precision_curve(pairs, overlaps, scores, 0.5, Roles(*roles, harmless), alike)
    expected, recall = plain_curve(frames, 0.5)
    assert curve.precision == pytest.approx(expected, abs=1e-15)
    assert curve.similarity == pytest.approx(expected, abs=1e-15)  # all pairs are alike
    assert curve.recall == recall
    assert 0 < ap_r40(curve.precision) < 100


def table(rows, score=False):
    columns = ["frame", "class", *GEOMETRY, *(["score"] if score else [])]
    return pd.DataFrame(rows, columns=columns).astype({"frame": np.int64})


def car(frame, x, name="Car", score=None):
    row = (frame, name, x, 0.0, 0.8, 4.0, 2.0, 1.6, 0.0)
    return row if score is None else (*row, score)


def values(*tables):
    return evaluate_boxes(*tables).set_index(["class", "metric", "iou"])["value"]


def test_perfect_and_absent_detections():
    truth = table([car(f, x) for f in range(50) for x in (5.0, 15.0)])
    perfect = truth.assign(score=0.5)
    result = evaluate_boxes(truth, perfect, range(50), ["Car"])
    assert (result.value == 100).all()
    assert tuple(result.columns) == COLUMNS
    assert (result.ground_truths == 100).all()
    assert set(result.difficulty) == {"all"}
    few = values(truth, perfect, range(8), ["Car"])
    assert few["Car", "AP_R40_BEV", 0.5] == pytest.approx(100 * 15 / 40)
    assert (values(truth, perfect[:0], range(50), ["Car"]) == 0).all()
    assert values(truth, perfect, [], ["Car"]).isna().all()
    for detected in (perfect, perfect[:0]):
        assert values(truth[:0], detected, range(50), ["Car"]).isna().all()


def test_ap_by_hand():
    # 40 cars; 20 hits have higher scores than 20 false alarms; precision 1 up to recall 1/2.
    truth = table([car(f, 5.0) for f in range(40)])
    places = [(f, x, score) for x, score in ((5.0, 0.9), (30.0, 0.1)) for f in range(20)]
    detected = table([car(f, x, score=score) for f, x, score in places], score=True)
    result = values(truth, detected, range(40), ["Car"])
    # KITTI's sampling reaches index 19 of 0 … 40 with 20 hits of 40, and index 0 is not averaged.
    assert result["Car", "AP_R40_3D", 0.7] == pytest.approx(100 * 19 / 40)
    assert result["Car", "recall", 0.7] == 50
    assert result["Car", "class_recall_3D", 0.7] == 50
    # With one score for all there is one working point: 20 hits and 20 false alarms.
    result = values(truth, detected.assign(score=0.5), range(40), ["Car"])
    assert result["Car", "AP_R40_3D", 0.7] == pytest.approx(50 * 19 / 40)


def test_overlap_must_exceed_the_threshold():
    # 4 m long boxes 4/3 m apart share half of their union, up to a rounding in x.
    truth = table([car(0, 4.0)])
    for shift, hits in ((4 / 3 + 1e-9, 0), (4 / 3 - 1e-9, 100)):
        detected = table([car(0, 4.0 + shift, score=0.5)], score=True)
        assert values(truth, detected, [0], ["Car"])["Car", "recall", 0.5] == hits
    # Exactly a quarter: 1 m shared of 2.5 + 2.5 - 1.
    truth.loc[0, "length"] = 2.5
    detected = table([car(0, 5.5, "Cyclist", 0.5)], score=True)
    detected.loc[0, "length"] = 2.5
    truth["class"] = "Cyclist"
    assert values(truth, detected, [0], ["Cyclist"])["Cyclist", "AP_R40_BEV", 0.25] == 0


def test_recall_takes_any_class_and_ap_only_its_own():
    truth = table([car(0, 5.0), car(0, 15.0, "Cyclist")])
    detected = table([car(0, 5.0, "Cyclist", 0.9)], score=True)
    result = values(truth, detected, [0], ["Car", "Cyclist", "Pedestrian"])
    assert result["Car", "recall", 0.7] == 100
    assert result["Car", "class_recall_3D", 0.7] == result["Car", "AP_R40_3D", 0.7] == 0
    assert result["Cyclist", "recall", 0.5] == 0
    assert result["all", "recall", 0.5] == 50
    assert np.isnan(result["Pedestrian", "AP_R40_3D", 0.5])
    assert np.isnan(result["Pedestrian", "recall", 0.7])


def test_recall_is_that_of_the_refined_boxes():
    truth = table([car(0, 5.0), car(1, 5.0), car(1, 15.0, "Cyclist"), car(2, 5.0)])
    detected = table([car(0, 5.0, score=0.9), car(2, 5.0, score=0.9)], score=True)
    refined = table([car(0, 30.0), car(1, 5.0), car(1, 15.3), car(3, 5.0)]).drop(columns="class")
    result = values(truth, detected, range(4), ["Car", "Cyclist"], refined)
    # 0.3 m of 4 m aside: IoU 3.7 / 4.3 in 3D.
    assert result["Cyclist", "recall", 0.7] == 100
    assert result["Car", "recall", 0.5] == pytest.approx(100 / 3)
    assert result["all", "recall", 0.7] == 50
    assert result["Car", "class_recall_3D", 0.7] == pytest.approx(200 / 3)
    assert values(truth, detected, range(4), ["Car"], refined[:0])["all", "recall", 0.5] == 0
    with refused(("refined boxes", "yaw", "")):
        evaluate_boxes(truth, detected, [0], ["Car"], refined.drop(columns="yaw"))


@pytest.mark.parametrize("wrong", ["ground truth", "detections", "refined boxes"])
def test_yaw_in_degrees_is_refused(wrong):
    truth, detected = table([car(0, 5.0)] * 3), table([car(0, 5.0, score=0.5)] * 3, score=True)
    tables = {"ground truth": truth, "detections": detected, "refined boxes": truth.copy()}
    tables[wrong] = tables[wrong].assign(yaw=[4 * math.pi, 90.0, 0.0])
    one, other, refined = tables.values()
    with refused((f"{wrong}: row 1", "yaw", "90")):
        evaluate_boxes(one, other, [0], ["Car"], refined)


def test_only_the_frames_asked_for_count_and_order_does_not_matter():
    truth = table([car(7, 5.0), car(3, 5.0), car(9, 5.0)])
    detected = table([car(9, 5.0, score=0.2), car(3, 5.0, score=0.9)], score=True)
    result = evaluate_boxes(truth, detected, [9, 7], ["Car"])
    assert (result.ground_truths == 2).all()
    assert (result[result.metric == "recall"].value == 50).all()
    turned = evaluate_boxes(truth[::-1], detected[::-1], [7, 9], ["Car"])
    pd.testing.assert_frame_equal(result, turned)


def test_bad_tables():
    truth = table([car(0, 5.0)])
    detected = table([car(0, 5.0, score=np.nan)], score=True)
    for bad in (np.nan, np.inf, -np.inf):
        with refused(("detections: row 0", "score", str(bad))):
            evaluate_boxes(truth, detected.assign(score=bad), [0], ["Car"])
    with refused(("detections", "score", "")):
        evaluate_boxes(truth, detected.drop(columns="score"), [0], ["Car"])
    with refused(("detections", "yaw", "")):
        evaluate_boxes(truth, detected.drop(columns="yaw"), [0], ["Car"])


def boxes(rng, number, frames):
    table = pd.DataFrame(rng.uniform(0, 30, (number, 3)), columns=["x", "y", "z"])
    table[["length", "width", "height"]] = rng.uniform(1, 4, (number, 3))
    table["yaw"] = rng.uniform(-3, 3, number)
    return table.assign(frame=rng.integers(0, frames, number), **{"class": "Car"})


@pytest.mark.parametrize("iou", [0.5, 0.7])
def test_their_share_is_the_recall_of_the_class(iou):
    rng = np.random.default_rng(1)
    truth = boxes(rng, 60, 9)
    detected = truth.sample(40, random_state=2)
    detected[["x", "length"]] *= rng.uniform(0.97, 1.03, (40, 2))
    detected = pd.concat([detected, boxes(rng, 20, 12)]).assign(score=rng.random(60))
    hit = found_objects(truth, detected, iou)
    metrics = evaluate_boxes(truth, detected, range(9), ["Car"])
    recall = metrics.set_index(["metric", "iou"])["value"]["class_recall_3D", iou]
    assert 100 * hit.mean() == pytest.approx(recall.item())
    assert 0 < hit.sum() < len(truth)
    one_by_one = [found_objects(truth.iloc[[n]], detected, iou)[0] for n in range(len(truth))]
    assert hit.tolist() == one_by_one  # no two of these take one detection


def test_a_detection_is_used_once_and_nothing_is_found_in_nothing():
    twins = table([car(1, 10.0), car(1, 10.0), car(2, 10.0)])
    detected = table([car(1, 10.0, score=0.5)], score=True)
    assert sorted(found_objects(twins, detected, 0.5)) == [False, False, True]
    assert not found_objects(twins, detected[:0], 0.5).any()
    assert len(found_objects(twins[:0], detected, 0.5)) == 0
