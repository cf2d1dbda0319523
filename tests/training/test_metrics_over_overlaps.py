"""Metrics of no single IoU, recall by direction, AP by distance, and the curve of AP."""

import math

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace.base import rings
from lidarplace.base.metrics import EVERY_IOU, MEAN_AP_IOU
from lidarplace.base.sectors import SECTORS, bounds_of, sector_of
from lidarplace.logs.boxes import GEOMETRY
from tests.training.plain_curve import plain_curve
from training.average_precision import COUNTS, FramePairs, Roles, precision_curve
from training.by_place import evaluate_by_distance, recall_by_sector
from training.kitti_ap import evaluate_boxes, evaluation
from training.matches import Matches

SIZE = (4.0, 2.0, 1.5)
FRAMES = 6
CLASSES = ["Car", "Pedestrian"]


def overlap(a, b):
    """3D IoU of boxes of one size whose sides are along the axes; of centres."""
    common = math.prod(max(0.0, s - abs(p - q)) for p, q, s in zip(a, b, SIZE, strict=True))
    return common / (2 * math.prod(SIZE) - common)


# Crowds of few places, so that boxes overlap each other and overlaps and scores are equal.
place = st.tuples(st.integers(-8, 8), st.integers(-6, 6), st.sampled_from([0.75, 1.0]))
name, frame = st.sampled_from(CLASSES), st.integers(0, FRAMES - 1)
truths_of = st.lists(st.tuples(frame, name, place), min_size=1, max_size=40)
found_of = st.lists(st.tuples(frame, name, place, st.integers(1, 9)), max_size=60)


def tables(truths, detected):
    """Boxes a quarter of a metre apart or more."""
    rows = [(f, n, 0.5 * x, 0.25 * y, z, *SIZE, 0.0) for f, n, (x, y, z) in truths]
    truth = pd.DataFrame(rows, columns=["frame", "class", *GEOMETRY])
    rows = [(f, n, 0.5 * x, 0.25 * y, z, *SIZE, 0.0, s / 10) for f, n, (x, y, z), s in detected]
    detections = pd.DataFrame(rows, columns=["frame", "class", *GEOMETRY, "score"])
    return truth, detections.astype({"frame": np.int64})


def overlaps_of(truth, detections):
    """Yield for every frame its ground truths' centres, and overlaps [truth][detection]."""
    for number in range(FRAMES):
        frame_truths, other = (t[t["frame"] == number] for t in (truth, detections))
        boxes = [frame_truths[["x", "y", "z"]].to_numpy(), other[["x", "y", "z"]].to_numpy()]
        table = np.array([[overlap(a, b) for b in boxes[1]] for a in boxes[0]])
        yield frame_truths, other, table.reshape(len(frame_truths), len(other))


@settings(max_examples=12)
@given(truths_of, found_of)
def test_they_are_what_plain_python_gives(truths, detected):
    truth, detections = tables(truths, detected)
    whole = evaluate_boxes(truth, detections, range(FRAMES), CLASSES)
    values = whole.set_index(["class", "metric", "iou"])["value"]
    best = [max(row, default=0.0) for *_, t in overlaps_of(truth, detections) for row in t]
    found_mean = values["all", "mean_overlap", EVERY_IOU]
    assert found_mean == pytest.approx(100 * np.mean(best), rel=1e-12)
    for name in truth["class"].unique():
        of_class, other = (t[t["class"] == name] for t in (truth, detections))
        frames = list(overlaps_of(of_class, other))
        best = [max(row, default=0.0) for *_, t in frames for row in t]
        found_mean = values[name, "mean_overlap", EVERY_IOU]
        assert found_mean == pytest.approx(100 * np.mean(best), rel=1e-12)
        roles = [
            (t, o["score"].to_numpy(), [COUNTS] * len(g), [COUNTS] * len(o)) for g, o, t in frames
        ]
        ious = np.arange(30, 81, 5) / 100
        expected = [100 * plain_curve(roles, iou)[0][1:].mean() for iou in ious]
        assert values[name, "AP_R40_3D_mean", EVERY_IOU] == pytest.approx(np.mean(expected))


@settings(max_examples=100)
@given(st.integers(0, 2**32), st.sampled_from(MEAN_AP_IOU))
def test_scores_of_ground_truths_give_kittis_curve(seed, iou):
    """Scores of matches give the whole curve, in any crowd and with any ties."""
    random = np.random.default_rng(seed)
    truths, detected = (np.sort(random.integers(0, 10, n)) for n in random.integers(1, 80, 2))
    pairs = FramePairs.of(truths, detected, 10)
    overlaps = np.round(random.random(len(pairs.detection)), random.integers(1, 4))
    scores = np.round(random.random(len(detected)), random.integers(1, 4))
    matches = Matches.of(pairs, overlaps, scores, iou)
    roles = (np.full(len(rows), COUNTS, np.int8) for rows in (truths, detected))
    harmless, alike = np.zeros(len(detected), bool), np.ones(len(overlaps))
    curve = precision_curve(pairs, overlaps, scores, iou, Roles(*roles, harmless), alike)
    assert matches.precision().tolist() == curve.precision.tolist()
    assert matches.found.mean() == curve.recall


def test_the_overlap_of_all_is_with_detections_and_not_with_refined_boxes():
    truth, detected = tables([(0, "Car", (0, 0, 0.75))], [(0, "Car", (2, 0, 0.75), 5)])
    exact = truth.drop(columns="class")
    table = evaluate_boxes(truth, detected, [0], ["Car"], exact)
    values = table.set_index(["class", "metric"])["value"]
    assert (values["all", "recall"] == 100).all()
    assert values["all", "mean_overlap"] == values["Car", "mean_overlap"] == pytest.approx(60)


@settings(max_examples=25)
@given(truths_of, found_of)
def test_recall_by_sector_is_that_of_its_objects(truths, detected):
    truth, detections = tables(truths, detected)
    whole = evaluation(truth, detections, range(FRAMES), CLASSES)
    by_sector = recall_by_sector(whole.objects)
    # One by one: the largest overlap with any box, by the angle to the middle of the sector.
    hits = {}
    for of_frame, _, table in overlaps_of(truth, detections):
        for (_, box), row in zip(of_frame.iterrows(), table, strict=True):
            for name in (box["class"], "all"):
                strict = 0.7 if name == "Car" else 0.5
                angle = math.degrees(math.atan2(box["y"], box["x"]))
                middles = [(45 * k, SECTORS[k]) for k in range(8)]
                near = [s for m, s in middles if -22.5 <= (angle - m + 180) % 360 - 180 < 22.5]
                hits.setdefault((name, near[0]), []).append(max(row, default=0.0) > strict)
    recall = by_sector[by_sector["metric"] == "recall"].set_index(["class", "sector"])
    expected = {key: 100 * np.mean(of_frame) for key, of_frame in hits.items()}
    assert recall["value"].to_dict() == pytest.approx(expected)
    assert recall["ground_truths"].to_dict() == {k: len(v) for k, v in hits.items()}
    total = whole.metrics.set_index(["class", "metric", "iou"])["value"]
    for (name, metric, iou), of_frame in by_sector.groupby(["class", "metric", "iou"]):
        mean = np.average(of_frame["value"], weights=of_frame["ground_truths"])
        assert mean == pytest.approx(total[name, metric, iou])


def test_sectors_go_round_and_hold_their_first_bound():
    angles = np.radians([0, 22.4, 22.6, -22.4, 90, 157.6, 180, -157.6, -45, -22.6])
    at = pd.DataFrame({"x": 7 * np.cos(angles), "y": 7 * np.sin(angles)})
    names = [SECTORS[i] for i in sector_of(at)]
    assert names[:5] == ["front", "front", "front left", "front", "left"]
    assert names[5:] == ["rear", "rear", "rear", "front right", "front right"]
    assert sector_of(pd.DataFrame({"x": [0.0], "y": [0.0]})).tolist() == [0]
    bounds = dict(zip(SECTORS, map(bounds_of, range(8)), strict=True))
    assert bounds["front"] == (-22.5, 22.5)
    assert bounds["right"] == (-112.5, -67.5)
    assert bounds["rear left"] == (112.5, 157.5)


def test_nothing_to_find_has_no_sector():
    truth, detected = tables([(0, "Car", (0, 0, 0.75))], [])
    whole = evaluation(truth[:0], detected, [0], CLASSES)
    assert recall_by_sector(whole.objects).empty
    values = evaluate_boxes(truth, detected, [0], CLASSES).set_index(["class", "metric"])["value"]
    assert values["Car", "mean_overlap"].item() == values["Car", "AP_R40_3D_mean"].item() == 0
    assert math.isnan(values["Pedestrian", "mean_overlap"].item())


CAR = {"z": 0.8, "length": 4.0, "width": 1.8, "height": 1.6, "yaw": 0.3}


def boxes(xs, frames, name="Car", **more):
    return pd.DataFrame({"frame": frames, "class": name, "x": xs, "y": 0.0, **CAR, **more})


def test_rings_hold_their_lower_bound():
    at = pd.DataFrame({"x": [0.0, 9.999, 10.0, -30.0, 0.0, 1e6], "y": [0.0, 0, 0, 0, -49.9, 0]})
    assert rings.ring_of(at).tolist() == [0, 0, 1, 3, 4, 5]
    assert [rings.bounds_of(i) for i in range(2)] == [(0, 10), (10, 20)]
    assert rings.bounds_of(len(rings.EDGES_M) - 2)[1] == np.inf


def test_a_detection_is_judged_with_the_object_that_it_overlaps():
    frames = list(range(50))
    detected = boxes(10.1, frames, score=0.9)  # its own centre is in the next ring
    table = evaluate_by_distance(boxes(9.9, frames), detected, frames, ["Car"])
    assert set(table["from_m"]) == {0.0}
    assert (table["value"] == 100).all()


def test_a_false_alarm_counts_in_the_ring_where_it_stands():
    frames = list(range(50))
    truths = pd.concat([boxes(5.0, frames), boxes(25.0, frames)])
    alarms = boxes(28.5, frames, score=0.99)  # overlaps nothing
    detected = pd.concat([truths.assign(score=0.5), alarms])
    table = evaluate_by_distance(truths, detected, frames, ["Car"])
    value = table[(table["metric"] == "AP_R40_3D") & (table["iou"] == 0.7)].set_index("from_m")
    assert value.loc[0.0, "value"] == 100
    assert value.loc[20.0, "value"] == pytest.approx(50)
    assert value["ground_truths"].tolist() == [50, 50]


def test_one_ring_alone_is_the_whole():
    rng = np.random.default_rng(0)
    frames = rng.integers(0, 40, 120)
    truths = boxes(rng.uniform(11, 19, 120), frames).assign(y=rng.uniform(-3, 3, 120))
    moved = truths.assign(x=truths["x"] + rng.normal(0, 0.3, 120), score=rng.random(120))
    detected = moved.sample(90, random_state=1)
    whole = evaluate_boxes(truths, detected, range(40), ["Car"]).set_index(["metric", "iou"])[
        "value"
    ]
    assert rings.ring_of(truths).tolist() == [1] * 120
    for row in evaluate_by_distance(truths, detected, range(40), ["Car"]).itertuples():
        assert row.value == whole[row.metric, row.iou]


def test_no_objects_no_rows():
    truths = boxes([5.0], [0])
    nothing = truths.iloc[:0]
    assert evaluate_by_distance(nothing, nothing.assign(score=1.0), [0], ["Car"]).empty
    only = evaluate_by_distance(truths, nothing.assign(score=1.0), [0], ["Car", "Cyclist"])
    assert set(only["class"]) == {"Car"}
    assert (only["value"] == 0).all()


def test_ap_is_the_mean_of_its_curve():
    rng = np.random.default_rng(3)
    frames = rng.integers(0, 60, 200)
    truths = boxes(rng.uniform(2, 40, 200), frames)
    detected = truths.assign(x=truths["x"] + rng.normal(0, 0.4, 200), score=rng.random(200))
    result = evaluation(truths, detected, range(60), ["Car", "Cyclist"])
    aps = result.metrics.query("metric in ('AP_R40_3D', 'AP_R40_BEV') and ground_truths > 0")
    assert len(aps) == 4
    for row in aps.itertuples():
        match = (result.curves["metric"] == row.metric) & (result.curves["iou"] == row.iou)
        curve = result.curves[match]
        assert curve["recall"].tolist() == np.linspace(0, 100, 41).tolist()
        assert curve["precision"].iloc[1:].mean() == pytest.approx(row.value, rel=1e-12)
    assert set(result.curves["class"]) == {"Car"}, "a class without ground truth has no curve"
