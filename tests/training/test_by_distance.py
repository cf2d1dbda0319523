"""AP by distance, and the curve that AP is the mean of."""

import numpy as np
import pandas as pd
import pytest

from lidarplace.base.rings import EDGES_M, bounds_of, ring_of
from training.by_distance import evaluate_by_distance
from training.kitti_ap import evaluate_boxes, evaluation

SIZE = {"z": 0.8, "length": 4.0, "width": 1.8, "height": 1.6, "yaw": 0.3}


def boxes(xs, frames, name="Car", **more):
    return pd.DataFrame({"frame": frames, "class": name, "x": xs, "y": 0.0, **SIZE, **more})


def test_rings_hold_their_lower_bound():
    at = pd.DataFrame({"x": [0.0, 9.999, 10.0, -30.0, 0.0, 1e6], "y": [0.0, 0, 0, 0, -49.9, 0]})
    assert ring_of(at).tolist() == [0, 0, 1, 3, 4, 5]
    assert [bounds_of(i) for i in range(2)] == [(0, 10), (10, 20)]
    assert bounds_of(len(EDGES_M) - 2)[1] == np.inf


def test_a_detection_is_judged_with_the_object_that_it_overlaps():
    frames = list(range(50))
    truths = boxes([9.9] * 50, frames)
    found = boxes([10.1] * 50, frames, score=0.9)  # its own centre is in the next ring
    table = evaluate_by_distance(truths, found, frames, ["Car"])
    assert set(table["from_m"]) == {0.0}
    assert (table["value"] == 100).all()


def test_a_false_alarm_counts_in_the_ring_where_it_stands():
    frames = list(range(50))
    truths = pd.concat([boxes([5.0] * 50, frames), boxes([25.0] * 50, frames)])
    alarms = boxes([28.5] * 50, frames, score=0.99)  # overlaps nothing
    found = pd.concat([truths.assign(score=0.5), alarms])
    table = evaluate_by_distance(truths, found, frames, ["Car"])
    value = table[(table["metric"] == "AP_R40_3D") & (table["iou"] == 0.7)].set_index("from_m")
    assert value.loc[0.0, "value"] == 100
    assert value.loc[20.0, "value"] == pytest.approx(50)
    assert value["ground_truths"].tolist() == [50, 50]


def test_one_ring_alone_is_the_whole():
    rng = np.random.default_rng(0)
    frames = rng.integers(0, 40, 120)
    truths = boxes(rng.uniform(11, 19, 120), frames).assign(y=rng.uniform(-3, 3, 120))
    moved = truths.assign(x=truths["x"] + rng.normal(0, 0.3, 120), score=rng.random(120))
    found = moved.sample(90, random_state=1)
    whole = evaluate_boxes(truths, found, range(40), ["Car"]).set_index(["metric", "iou"])["value"]
    assert ring_of(truths).tolist() == [1] * 120
    for row in evaluate_by_distance(truths, found, range(40), ["Car"]).itertuples():
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
    found = truths.assign(x=truths["x"] + rng.normal(0, 0.4, 200), score=rng.random(200))
    result = evaluation(truths, found, range(60), ["Car", "Cyclist"])
    aps = result.metrics.query("metric in ('AP_R40_3D', 'AP_R40_BEV') and ground_truths > 0")
    assert len(aps) == 4
    for row in aps.itertuples():
        match = (result.curves["metric"] == row.metric) & (result.curves["iou"] == row.iou)
        curve = result.curves[match]
        assert curve["recall"].tolist() == np.linspace(0, 100, 41).tolist()
        assert curve["precision"].iloc[1:].mean() == pytest.approx(row.value, rel=1e-12)
    assert set(result.curves["class"]) == {"Car"}, "a class without ground truth has no curve"
