"""Typical objects of classes, and detectors whose anchors are like them."""

import re

import numpy as np
import pandas as pd
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from lidarplace.base.metrics import Overlaps
from lidarplace.logs.boxes import GEOMETRY
from tests.refused import refused
from tests.training.synthetic_scenes import packed
from training import NETWORKS, build_detector
from training.checkpoints import load_checkpoint, read_checkpoint, write_checkpoint
from training.finetune import finetune
from training.kitti_ap import evaluate_boxes
from training.settings import TrainingSettings
from training.typical_objects import TypicalObject, as_plain, from_plain, typical_objects

TRUCK = TypicalObject("Truck", (7.5, 2.5, 3.2), 0.25)
SCOOTER = TypicalObject("Scooter", (1.8, 0.7, 1.4))


def boxes(*rows):
    columns = ["frame", "object_id", "class", *GEOMETRY]
    return pd.DataFrame(rows, columns=columns)


def test_individuals_count_once():
    some = boxes(
        *((frame, "a", "Truck", 9, 0, 2.0, 8, 2, 3, 0) for frame in range(3)),
        (0, "b", "Truck", 9, 5, 1.5, 6, 3, 2, 0),
        (0, "c", "Car", 9, 9, 0.8, 4, 2, 1.6, 0),
    )
    assert typical_objects(some, ["Truck"]) == (TypicalObject("Truck", (7.0, 2.5, 2.5), 0.5),)


Metres = st.floats(0.01, 50)


@given(st.lists(st.builds(TypicalObject, st.text(), st.tuples(Metres, Metres, Metres), Metres)))
def test_plain_and_back(typical):
    assert from_plain({"typical": as_plain(typical)}) == tuple(typical)


@pytest.mark.parametrize("network", NETWORKS)
@pytest.mark.parametrize("preset", ["tiny", "openpcdet"])
def test_every_network_has_anchors_of_other_classes(network, preset):
    classes = ["Car", "Truck", "Scooter"]
    model = build_detector(network, classes, preset, typical=[TRUCK, SCOOTER])
    plain = build_detector(network, ["Car"], preset)
    assert model.typical == (TRUCK, SCOOTER)
    if hasattr(model, "dense_head"):
        car, truck, scooter = model.dense_head.classes
        assert car == plain.dense_head.classes[0]
        assert truck.size == TRUCK.size
        assert truck.bottom == 0.25 - model.sensor_height
        # As large as a car at least, and smaller than one: so they learn from the same overlaps.
        assert (truck.matched, truck.unmatched) == (car.matched, car.unmatched)
        assert scooter.matched < car.matched
        rows = model.dense_head.anchors.reshape(-1, 3, 2, 7)[:, 1]
        bottoms = rows[..., 2] - rows[..., 5] / 2 + model.sensor_height
        torch.testing.assert_close(bottoms, torch.full_like(bottoms, 0.25), atol=1e-5, rtol=0)
    else:
        assert model.point_head.sizes.tolist()[1:] == pytest.approx(
            [pytest.approx(TRUCK.size), pytest.approx(SCOOTER.size)]
        )


def test_a_checkpoint_has_its_anchors(tmp_path):
    classes = ["Car", "Truck"]
    model = build_detector("pointpillars_tiny", classes, typical=[TRUCK])
    path = tmp_path / "base.pt"
    write_checkpoint(path, model.state_dict(), "pointpillars_tiny", classes, model.typical)
    assert from_plain(read_checkpoint(path)[0]) == (TRUCK,)
    again = build_detector("pointpillars_tiny", classes, typical=[TRUCK])
    assert load_checkpoint(again, path).reinitialised == ()
    shorter = TypicalObject("Truck", (6.0, 2.5, 3.2), 0.25)
    other = build_detector("pointpillars_tiny", classes, typical=[shorter])
    with refused(f"; expected {re.escape(f'{shorter}, found {TRUCK}')}; "):
        load_checkpoint(other, path)
    reinitialised = load_checkpoint(other, path, new_heads=True).reinitialised
    assert {key.split(".")[0] for key in reinitialised} == {"dense_head"}


def test_a_training_measures_classes_that_nothing_knows():
    truths = boxes(
        *((frame, "a", "Truck", 12, 0, 1.6, 7.5, 2.5, 3.2, 0) for frame in range(2)),
        *((frame, "b", "Car", 12, 8, 0.8, 4.4, 1.8, 1.6, 0) for frame in range(2)),
    )
    points = np.random.default_rng(0).uniform([8, -2, 0, 0], [16, 9, 3, 1], (400, 4))
    clouds = packed(np.arange(2), [points] * 2)
    settings = TrainingSettings(epochs=1, batch_size=2, sample_groups={})
    result = finetune("pointpillars_tiny", ["Car", "Truck"], clouds, truths, settings, seed=0)
    assert result.typical == (TypicalObject("Truck", (7.5, 2.5, 3.2), 0.0),)


def test_classes_are_judged_at_their_own_overlaps():
    truth = boxes((0, "a", "Truck", 10, 0, 1.6, 8, 2, 3, 0))
    # Moved by 2 of 8 metres: an IoU of 6 / 10.
    detected = truth.assign(x=12.0, score=0.9)
    at = evaluate_boxes(truth, detected, [0], ["Truck"], ious={"Truck": Overlaps(0.65, 0.55)})
    recall = at[at["metric"] == "class_recall_3D"].set_index("iou")["value"]
    assert recall.to_dict() == {0.65: 0.0, 0.55: 100.0}
    kitti = evaluate_boxes(truth, detected, [0], ["Truck"])
    assert set(kitti.loc[kitti["metric"] == "AP_R40_3D", "iou"]) == {0.5, 0.25}
