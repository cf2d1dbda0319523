"""Training: data, augmentation, schedule, settings, and whether it learns."""

import hashlib
import json
import re
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
import torch

from lidarplace.clouds.clouds import JoinedClouds
from lidarplace.clouds.points_in_boxes import count_points
from lidarplace.logs.boxes import GEOMETRY
from tests.refused import refused
from tests.training.synthetic_scenes import BOX_COLUMNS, PLAIN, packed, scenes
from training import batch_size, build_detector
from training.batch_size import batch_size_for
from training.dataset import TrainingFrames, as_tensors, occurring_classes, spread
from training.detect import detect
from training.finetune import TrainingContext, finetune
from training.optimisation import Optimisation, one_cycle
from training.settings import TrainingSettings

pytestmark = pytest.mark.usefixtures("one_thread")

TINY = "pointpillars_tiny"


def car_frames(*data, height=0.0, least=1, **more):
    return TrainingFrames(["Car"], *data, height, least, **more)


def test_same_seed_same_result_and_the_callers_state_is_left_alone():
    clouds, truth = scenes(4, seed=1, classes=("Car", "Pedestrian"))
    settings = TrainingSettings(epochs=2, batch_size=2)
    before = torch.get_rng_state()
    data = ["Pedestrian", "Car"], clouds, truth
    runs = [finetune(TINY, *data, settings, seed) for seed in (3, 3, 4)]
    assert torch.equal(before, torch.get_rng_state())
    weight = "dense_head.conv_box.weight"
    for key, value in runs[0].state_dict.items():
        assert torch.equal(value, runs[1].state_dict[key]), key
    assert not torch.equal(runs[0].state_dict[weight], runs[2].state_dict[weight])
    assert runs[0].state_dict["global_step"] == 4
    assert set(runs[0].curve.epoch) == {1, 2}
    assert set(runs[0].curve.metric) == {
        "loss", "classification", "location", "direction", "lr", "seconds",
    }  # fmt: skip


def test_rigs_of_one_seed_are_trained_on_the_same_frames_moved_alike(monkeypatch):
    """Order, mirror, turn and scale of every frame, though the rigs' points differ in number."""
    clouds, truth = scenes(4, seed=1)
    thinned = packed(clouds.frames, (clouds[k][::3] for k in range(len(clouds))))
    wide = (-48.0, -48.0, -1.0, 48.0, 48.0, 5.0)  # no box is cut off
    settings = TrainingSettings(epochs=2, batch_size=2, min_points=0, sample_groups={"Car": 1})
    boxes: list[list[np.ndarray]] = []

    def spy(samples):
        boxes[-1].extend(sample.boxes for sample in samples)
        return as_tensors(samples)

    monkeypatch.setattr("training.finetune.as_tensors", spy)
    for rig in (clouds, thinned):
        boxes.append([])
        finetune(TINY, ["Car"], rig, truth, settings, 3, TrainingContext(wide))
    assert len(boxes[0]) == 8
    for one, other in zip(*boxes, strict=True):
        assert np.array_equal(one, other)


def test_frames_without_points_or_boxes_and_a_checkpoint(tmp_path):
    clouds = packed([5, 6], [np.zeros((0, 4))] * 2)
    numbers = dict.fromkeys(("frame", *GEOMETRY), np.float64)
    nothing = pd.DataFrame(columns=BOX_COLUMNS).astype(numbers)
    settings = TrainingSettings(epochs=1, batch_size=2)
    first = finetune(TINY, ["Car"], clouds, nothing, settings, seed=0)
    detected = detect(TINY, ["Car"], first.state_dict, clouds, settings).boxes
    assert list(detected.columns) == [*BOX_COLUMNS, "score"]
    assert len(detected) == 0
    path, two = tmp_path / "weights.pt", ["Car", "Cyclist"]
    torch.save(first.state_dict, path)
    further = settings.model_copy(update={"checkpoint": path})
    second = finetune(TINY, ["Car"], clouds, nothing, further, seed=1)
    assert second.state_dict["global_step"] == 2
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    assert (first.weights, second.weights) == ("scratch", f"weights.pt sha256:{digest[:12]}")
    with refused(rf"^{path}: dense_head\.conv_cls\.weight, "):
        finetune(TINY, two, clouds, nothing, further, seed=1)
    other = TrainingContext(digest="0" * 64)
    with refused((str(path), "", "")):
        finetune(TINY, ["Car"], clouds, nothing, further, seed=1, context=other)
    further = further.model_copy(update={"new_heads": True})
    third = finetune(TINY, two, clouds, nothing, further, seed=1)
    assert ", from scratch: dense_head.conv_cls.weight, dense_head.conv_cls.bias," in third.weights
    none = packed([], [])
    with refused(("", "clouds", "none")):
        finetune(TINY, ["Car"], none, nothing, settings, seed=0)
    assert detect(TINY, ["Car"], first.state_dict, none, settings).boxes.empty


def test_detections_come_back_in_the_ego_frame():
    """The KITTI network works 1.73 m above the ground: boxes are moved there and back."""
    clouds, truth = scenes(1, seed=2)
    frames = car_frames(clouds, truth, height=1.73)
    seen = count_points(clouds[0], truth[list(GEOMETRY)]) >= 1
    expected = truth[list(GEOMETRY)].to_numpy()[seen]
    np.testing.assert_allclose(frames[0].boxes[:, 2], expected[:, 2] - 1.73, atol=1e-5)
    np.testing.assert_allclose(frames[0].points[:, 2], clouds[0][:, 2] - 1.73, atol=1e-5)
    torch.manual_seed(2)
    model = build_detector("pointpillars", ["Car"], point_range=(0, -10, 0, 20, 10, 4))
    with torch.no_grad():
        model.dense_head.conv_cls.bias.fill_(5.0)  # every anchor is a detection
    settings, area = TrainingSettings(batch_size=1), (0, -10, 0, 20, 10, 4)
    detected = detect("pointpillars", ["Car"], model.state_dict(), clouds, settings, area).boxes
    assert len(detected) > 20
    # An untrained box head leaves the anchors almost as they are: bottom at -1.78 + 1.73.
    assert (detected.z - detected.height / 2).median() == pytest.approx(-0.05, abs=0.1)


def test_frames_drop_other_classes_and_unseen_objects():
    clouds, truth = scenes(3, seed=3, classes=("Car", "Cyclist"), objects=8)
    frames = TrainingFrames(["Cyclist"], clouds, truth, 0.0, min_points=5)
    for index in range(3):
        cyclists = truth[(truth.frame == index) & (truth["class"] == "Cyclist")]
        counts = count_points(clouds[index], cyclists[list(GEOMETRY)])
        assert len(frames[index].boxes) == (counts >= 5).sum()
        assert (frames[index].labels == 1).all()
    assert sum(len(frames[i].boxes) for i in range(3)) > 0


def test_one_cycle():
    settings = TrainingSettings(lr=0.01, div_factor=10, pct_start=0.4, moms=(0.95, 0.85))
    for step, rate in {0: 0.001, 20: 0.0055, 40: 0.01, 70: (0.01 + 1e-7) / 2}.items():
        assert one_cycle(settings, 100, step) == pytest.approx(
            (rate, {0: 0.95, 40: 0.85}.get(step, 0.90))
        )
    rates = [one_cycle(settings, 100, step)[0] for step in range(100)]
    assert all(a < b for a, b in pairwise(rates[:41]))
    assert all(a > b for a, b in pairwise(rates[40:]))
    assert one_cycle(settings, 1, 0) == pytest.approx((0.01, 0.85))


def test_sgd_learns_too():
    clouds, truth = scenes(4, seed=5)
    settings = PLAIN.model_copy(update={"optimizer": "sgd", "epochs": 15, "batch_size": 2})
    result = finetune(TINY, ["Car"], clouds, truth, settings, seed=0)
    loss = result.curve[result.curve.metric == "loss"]["value"].to_numpy()
    assert loss[-1] < 0.7 * loss[0]


def test_a_loss_that_is_not_finite_names_its_frames():
    clouds, truth = scenes(3, seed=6)
    settings = PLAIN.model_copy(update={"optimizer": "sgd", "lr": 1e30, "batch_size": 2})
    message = r"is (nan|inf) in epoch \d+, step [12], frames \[\d.*a lower lr"
    with pytest.raises(ArithmeticError, match=message) as caught:
        finetune(TINY, ["Car"], clouds, truth, settings, seed=0)
    assert set(json.loads(re.findall(r"\[.*\]", str(caught.value))[0])) <= {0, 1, 2}


def test_a_gradient_that_is_not_finite_leaves_the_weights():
    model = build_detector(TINY, ["Car"])
    first = next(model.parameters())
    first.register_hook(lambda gradient: gradient * torch.nan)
    before = [item.clone() for item in model.parameters()]
    frames = car_frames(*scenes(1, seed=6))
    with pytest.raises(ArithmeticError, match="gradient is nan"):
        Optimisation(model, PLAIN, steps=1).step(as_tensors([frames[0]]))
    assert all(torch.equal(a, b) for a, b in zip(before, model.parameters(), strict=True))


def test_scaled_losses_give_the_same_steps_and_overflows_are_left_out():
    """Train with the scaler of float16, here on float32, which it leaves as it is."""
    frames = car_frames(*scenes(2, seed=6))
    scales = []
    for scale in (None, 1024.0, 1e38):
        torch.manual_seed(0)
        model = build_detector(TINY, ["Car"])
        before = [item.clone() for item in model.parameters()]
        optimisation = Optimisation(model, PLAIN, steps=2)
        if scale is not None:
            optimisation._scaler = torch.amp.GradScaler("cpu", init_scale=scale)
        optimisation.step(as_tensors([frames[0], frames[1]]))
        scales.append([a - b for a, b in zip(model.parameters(), before, strict=True)])
    plain, scaled, overflown = scales
    assert any(item.abs().max() > 1e-4 for item in plain)
    for one, other in zip(plain, scaled, strict=True):
        assert torch.allclose(one, other, atol=1e-5)
    assert all((item == 0).all() for item in overflown)


def test_a_share_of_the_frames_is_evenly_spread():
    assert spread(16, 1 / 8).tolist() == [0, 8]
    assert spread(16, 1 / 4).tolist() == [0, 4, 8, 12]
    assert spread(10, 0.3).tolist() == [0, 3, 6]
    assert spread(5, 0.01).tolist() == [0]
    assert spread(5, 1.0).tolist() == list(range(5))
    assert spread(0, 1.0).tolist() == []
    clouds, truth = scenes(8, seed=7)
    settings = PLAIN.model_copy(update={"epochs": 1, "batch_size": 2, "frame_share": 0.5})
    result = finetune(TINY, ["Car"], clouds, truth, settings, seed=0)
    assert result.state_dict["global_step"] == 2
    frames = car_frames(clouds, truth, least=0, share=0.25)
    assert frames.numbers.tolist() == [0, 4]
    assert np.array_equal(frames[1].points, clouds[4])
    assert len(frames[1].boxes) == (truth.frame == 4).sum()


def test_classes_that_do_not_occur_are_left_out():
    clouds, truth = scenes(4, seed=8, classes=("Car", "Pedestrian"))
    everything = ("Cyclist", "Pedestrian", "Car")
    assert occurring_classes(everything, clouds, truth) == ("Pedestrian", "Car")
    cars = truth[(truth["class"] == "Car") | (truth["frame"] > 0)]
    assert occurring_classes(everything, clouds, cars, share=0.25) == ("Car",)
    assert occurring_classes(everything, clouds, truth.iloc[:0]) == everything


def test_the_clouds_of_two_placements_share_their_objects():
    clouds, truth = scenes(3, seed=9, objects=8)
    frames = car_frames(JoinedClouds([clouds, clouds]), truth)
    assert frames.numbers.tolist() == [0, 1, 2, 0, 1, 2]
    for index in range(3):
        assert np.array_equal(frames[index].boxes, frames[index + 3].boxes)
        assert len(frames[index].boxes)


def test_batch_size(monkeypatch):
    clouds, truth = scenes(3, seed=10)
    frames = car_frames(clouds, truth)
    model = build_detector(TINY, ["Car"])
    assert batch_size_for(model, frames, PLAIN) == 4  # on a CPU
    assert batch_size_for(model, frames, PLAIN.model_copy(update={"batch_size": 3})) == 3
    monkeypatch.setattr(type(model), "device", torch.device("meta"))  # not a CPU
    for most, expected in {0: 1, 1: 1, 3: 2, 8: 8, 15: 8, 99: 16}.items():
        monkeypatch.setattr(batch_size, "_fits", lambda *args, most=most: args[-1] <= most)
        assert batch_size_for(model, frames, PLAIN) == expected
    monkeypatch.undo()
    sizes = [len(sample.points) for sample in frames.largest(4)]
    counts = sorted(map(len, clouds), reverse=True)
    assert sizes == [*counts, counts[0]]
    result = finetune(TINY, ["Car"], clouds, truth, PLAIN.model_copy(update={"epochs": 1}), 0)
    assert (result.batch_size, result.state_dict["global_step"]) == (4, 1)
