"""Which objects were found, against recall and against one object at a time."""

import numpy as np
import pandas as pd
import pytest

from lidarplace.logs.boxes import GEOMETRY
from training.found_objects import found_objects
from training.kitti_ap import evaluate_boxes


def boxes(rng, number, frames):
    table = pd.DataFrame(rng.uniform(0, 30, (number, 3)), columns=["x", "y", "z"])
    table[["length", "width", "height"]] = rng.uniform(1, 4, (number, 3))
    table["yaw"] = rng.uniform(-3, 3, number)
    return table.assign(frame=rng.integers(0, frames, number), **{"class": "Car"})


@pytest.mark.parametrize("iou", [0.5, 0.7])
def test_their_share_is_the_recall_of_the_class(iou):
    rng = np.random.default_rng(1)
    truth = boxes(rng, 60, 9)
    found = truth.sample(40, random_state=2)
    found[["x", "length"]] *= rng.uniform(0.97, 1.03, (40, 2))
    found = pd.concat([found, boxes(rng, 20, 12)]).assign(score=rng.random(60))
    hit = found_objects(truth, found, iou)
    metrics = evaluate_boxes(truth, found, range(9), ["Car"])
    recall = metrics.loc[
        (metrics["metric"] == "class_recall_3D") & (metrics["iou"] == iou), "value"
    ]
    assert 100 * hit.mean() == pytest.approx(recall.item())
    assert 0 < hit.sum() < len(truth)
    one_by_one = [found_objects(truth.iloc[[n]], found, iou)[0] for n in range(len(truth))]
    assert hit.tolist() == one_by_one  # no two of these take one detection


def test_a_detection_is_used_once_and_nothing_is_found_in_nothing():
    car = dict(zip(GEOMETRY, (10, 0, 1, 4, 2, 2, 0), strict=True))
    twins = pd.DataFrame([car | {"frame": 1}, car | {"frame": 1}, car | {"frame": 2}])
    found = pd.DataFrame([car | {"frame": 1, "score": 0.5}])
    assert sorted(found_objects(twins, found, 0.5)) == [False, False, True]
    assert not found_objects(twins, found[:0], 0.5).any()
    assert len(found_objects(twins[:0], found, 0.5)) == 0
