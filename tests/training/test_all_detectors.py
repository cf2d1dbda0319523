"""What holds for every network: OpenPCDet's state_dict, odd clouds, mixed precision, seeds."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from openpcdet_reference import keys_and_shapes, reference

from training import NETWORKS, build_detector

CLASSES = ("Car", "Pedestrian", "Cyclist")
MODELS = {"voxel_rcnn": "voxel_rcnn_car"}
"""OpenPCDet's names of networks that are called otherwise there."""


def tiny(network):
    torch.manual_seed(0)
    return build_detector(network, CLASSES, preset="tiny")


def cloud(count, seed=0):
    random = np.random.default_rng(seed)
    points = random.uniform((0, -20, 0, 0), (40, 20, 3, 1), (count, 4))
    return torch.from_numpy(points.astype(np.float32))


def objects():
    boxes = torch.tensor([[10, 2, 0.8, 4.2, 1.8, 1.6, 0.3], [20, -5, 0.9, 0.8, 0.7, 1.7, 0.0]])
    return boxes, torch.tensor([1, 2])


@pytest.mark.parametrize("network", [n for n in NETWORKS if n != "pointpillars"])
def test_state_dict_is_openpcdets(network):
    data = reference(MODELS.get(network, network))
    model = build_detector(network, [str(name) for name in data["classes"]], preset="openpcdet")
    found = {
        key: (tuple(value.shape), str(value.dtype)) for key, value in model.state_dict().items()
    }
    assert found == keys_and_shapes(data)


ODD_CLOUDS = {
    "no point": cloud(0),
    "one point": torch.tensor([[10.0, 0.0, 1.0, 0.5]]),
    "all in one voxel": torch.tensor([[10.0, 0.0, 1.0, 0.5]]).repeat(3000, 1),
    "on the border": torch.tensor(
        [[x, y, z, 0.5] for x in (0.0, 40.0) for y in (-20.0, 20.0) for z in (0.0, 4.0)]
    ),
    "outside": cloud(500) + torch.tensor([500.0, 0, 0, 0]),
    "not finite": torch.cat(
        [cloud(500), torch.full((5, 4), torch.nan), torch.full((5, 4), -torch.inf)]
    ),
    "intensity not finite": torch.tensor([[10.0, 0.0, 1.0, torch.nan]]).repeat(20, 1),
}


@pytest.mark.parametrize("kind", ODD_CLOUDS)
@pytest.mark.parametrize("network", NETWORKS)
def test_odd_clouds_train_and_predict(network, kind):
    """Alone, and beside an ordinary frame; with objects and without."""
    model = tiny(network)
    odd = ODD_CLOUDS[kind].clone()
    none = torch.zeros(0, 7), torch.zeros(0, dtype=torch.int64)
    for points, targets in (
        ([odd], [objects()]),
        ([odd, cloud(3000)], [none, objects()]),
        ([cloud(3000), odd], [objects(), none]),
    ):
        boxes, labels = zip(*targets, strict=True)
        loss = model.train().loss(points, boxes, labels)["loss"]
        assert torch.isfinite(loss)
        loss.backward()
        assert all(torch.isfinite(p.grad).all() for p in model.parameters() if p.grad is not None)
        for frame in model.predict(points):
            assert frame["boxes"].shape == (len(frame["scores"]), 7)
            assert all(torch.isfinite(value).all() for value in frame.values())
    assert torch.equal(ODD_CLOUDS[kind].nan_to_num(), odd.nan_to_num()), "the caller's points"


@pytest.mark.parametrize("network", NETWORKS)
def test_points_that_are_not_finite_change_nothing(network):
    model = tiny(network)
    points = cloud(3000)
    bad = torch.tensor([[torch.nan, 0, 1, 0.5], [10, torch.inf, 1, 0.5], [10, 0, 1, torch.nan]])
    clean, mixed = model.predict([points, torch.cat([bad, points])])
    for key, value in clean.items():
        assert torch.allclose(value, mixed[key], atol=1e-4), key


@pytest.mark.parametrize("network", NETWORKS)
def test_a_million_points(network):
    near = cloud(1_000_000) * torch.tensor([0.25, 0.25, 1, 1])
    found = tiny(network).predict([near])
    assert torch.isfinite(found[0]["boxes"]).all()


@pytest.mark.parametrize("network", NETWORKS)
def test_mixed_precision_trains(network):
    model = tiny(network).train()
    boxes, labels = objects()
    with torch.autocast("cpu", dtype=torch.bfloat16):
        losses = model.loss([cloud(3000)], [boxes], [labels])
    assert losses["loss"].dtype == torch.float32
    losses["loss"].backward()
    assert all(torch.isfinite(p.grad).all() for p in model.parameters() if p.grad is not None)


@pytest.mark.parametrize("network", NETWORKS)
def test_the_seed_fixes_a_step_and_prediction_needs_none(network):
    losses, found = [], []
    for _ in range(2):
        model = tiny(network)
        torch.manual_seed(1)
        losses.append(model.loss([cloud(3000)], *([item] for item in objects()))["loss"].item())
        torch.manual_seed(len(losses))
        found.append(model.predict([cloud(3000)])[0])
    assert losses[0] == losses[1]
    for key, value in found[0].items():
        assert torch.equal(value, found[1][key])


@pytest.mark.parametrize("network", NETWORKS)
def test_only_the_classes_asked_for_have_anchors_and_heads(network):
    both, one = tiny(network), build_detector(network, ["Car"], preset="tiny")
    assert sum(p.numel() for p in one.parameters()) < sum(p.numel() for p in both.parameters())
    if hasattr(one, "dense_head"):
        assert one.dense_head.anchors.shape[2] * 3 == both.dense_head.anchors.shape[2]
    found = one.predict([cloud(3000)])[0]
    assert (found["labels"] == 1).all()
