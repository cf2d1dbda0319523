"""Properties of every network: OpenPCDet's state_dict, odd clouds, precision, seeds, ranges."""

import copy
from functools import cache

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch.nn.modules.batchnorm import _BatchNorm

from tests.refused import refused
from tests.training.openpcdet_reference import keys_and_shapes, reference
from training import NETWORKS, build_detector
from training.detect import fold_batch_norm
from training.detectors.detector import Selection, fitted_range
from training.device import settle_vector_math

pytestmark = pytest.mark.usefixtures("one_thread")

CLASSES = ("Car", "Pedestrian", "Cyclist")
MODELS = {"pointpillars": "pointpillar", "voxel_rcnn": "voxel_rcnn_car"}
"""OpenPCDet's names of networks that are called otherwise there."""
OTHERS = [
    pytest.param(name, marks=pytest.mark.long if name == "second" else ())
    for name in NETWORKS
    if name != "pointrcnn_iou"
]
"""Those that are not PointRCNN with other targets of its scores; SECOND-IoU begins with SECOND."""
ANY = Selection(score=0.0, post=50)
"""The best boxes whatever their scores: those of an untrained network are low."""


def cloud(count, seed=0):
    random = np.random.default_rng(seed)
    points = random.uniform((0, -20, 0, 0), (40, 20, 3, 1), (count, 4))
    return torch.from_numpy(points.astype(np.float32))


def objects():
    boxes = torch.tensor([[10, 2, 0.8, 4.2, 1.8, 1.6, 0.3], [20, -5, 0.9, 0.8, 0.7, 1.7, 0.0]])
    return boxes, torch.tensor([1, 2])


@cache
def awake(network):
    """A tiny network, and its boxes in an ordinary cloud.

    Its batch norms know what they normalise. Untrained, they let signals fade on their way through
    the deeper networks, until the result no longer depends on the points.
    """
    torch.manual_seed(0)
    model = build_detector(network, CLASSES, preset="tiny").train()
    norms = [layer for layer in model.modules() if isinstance(layer, _BatchNorm)]
    momenta = [item.momentum for item in norms]
    for item in norms:
        item.momentum = 1.0
    model.loss([cloud(3000, seed=1)], *([item] for item in objects()))
    for item, momentum in zip(norms, momenta, strict=True):
        item.momentum = momentum
    return model, model.predict([cloud(3000)], ANY)[0]


def tiny(network):
    return copy.deepcopy(awake(network)[0])


def assert_same_boxes(detected, expected):
    assert len(expected["boxes"]) > 0
    for key, value in expected.items():
        torch.testing.assert_close(detected[key], value, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("network", NETWORKS)
def test_state_dict_is_openpcdets(network):
    data = reference(MODELS.get(network, network))
    model = build_detector(network, [str(name) for name in data["classes"]], preset="openpcdet")
    state = model.state_dict()
    shapes = {key: (tuple(value.shape), str(value.dtype)) for key, value in state.items()}
    assert shapes == keys_and_shapes(data)


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


def assert_trains(model, points, targets):
    loss = model.train().loss(points, *zip(*targets, strict=True))["loss"]
    assert torch.isfinite(loss)
    assert loss.dtype == torch.float32
    loss.backward()
    assert all(torch.isfinite(p.grad).all() for p in model.parameters() if p.grad is not None)


@pytest.mark.parametrize("network", OTHERS)
def test_odd_clouds_train_and_predict(network):
    """Alone with objects, and without others an ordinary frame, which keeps its boxes."""
    model, expected = tiny(network), awake(network)[1]
    odd = [item.clone() for item in ODD_CLOUDS.values()]
    *others, ordinary = model.predict([*odd, cloud(3000)], ANY)
    assert_same_boxes(ordinary, expected)
    for frame in (*others, *(model.predict([item], ANY)[0] for item in odd)):
        assert frame["boxes"].shape == (len(frame["scores"]), 7)
        assert all(torch.isfinite(value).all() for value in frame.values())
    none = torch.zeros(0, 7), torch.zeros(0, dtype=torch.int64)
    assert_trains(model, [cloud(3000), *odd], [objects(), *[none] * len(odd)])
    for item, original in zip(odd, ODD_CLOUDS.values(), strict=True):
        assert_trains(model, [item], [objects()])
        assert torch.equal(original.nan_to_num(), item.nan_to_num()), "the caller's points"


@pytest.mark.parametrize("network", OTHERS)
def test_points_that_are_not_finite_change_nothing(network):
    points = cloud(3000)
    bad = cloud(1200, seed=3)
    for column in range(4):
        bad[column::8, column] = torch.nan
        bad[column + 4 :: 8, column] = torch.inf
    frames = [torch.cat([bad, points]), cloud(3000, seed=2)]
    detected, other = tiny(network).predict(frames, ANY)
    assert_same_boxes(detected, awake(network)[1])
    assert not torch.allclose(other["scores"][:2], detected["scores"][:2], rtol=1e-3)


@pytest.mark.parametrize("network", OTHERS)
def test_a_million_points(network):
    near = cloud(1_000_000) * torch.tensor([0.25, 0.25, 1, 1])
    detected = tiny(network).predict([near], ANY)[0]
    assert len(detected["boxes"]) > 0
    assert torch.isfinite(detected["boxes"]).all()


def size_biases(model):
    """The biases that set length, width, height: of one anchor in two, of a second stage."""
    if hasattr(model, "dense_head"):
        yield model.dense_head.conv_box.bias.view(-1, 7)[::2, 3:6]
    else:
        yield model.point_head.box_layers[-1].bias[3:6]
    branch = getattr(getattr(model, "roi_head", None), "reg_layers", None)
    if branch is not None:
        yield branch[-1].bias[3:6]


@pytest.mark.parametrize("network", OTHERS)
def test_boxes_that_are_not_finite_are_no_detections(network):
    stages = len(list(size_biases(tiny(network))))
    for stage in range(stages):
        model = tiny(network)
        with torch.no_grad():
            list(size_biases(model))[stage].fill_(1000.0)
        detected = model.predict([cloud(3000)], ANY)[0]
        assert all(torch.isfinite(value).all() for value in detected.values())
        # The other anchors are left.
        assert (len(detected["boxes"]) > 0) == (stage == 0 and hasattr(model, "dense_head"))


@pytest.mark.parametrize("network", NETWORKS)
def test_labels_must_be_the_classes(network):
    model = build_detector(network, ["Car"], preset="tiny").train()
    for label in (0, 2, -1):
        with refused(("", "labels", f"[{label}]")):
            model.loss([cloud(100)], [objects()[0]], [torch.tensor([1, label])])


@pytest.mark.parametrize("network", OTHERS)
def test_double_precision_predicts(network):
    single = awake(network)[1]
    detected = tiny(network).double().predict([cloud(3000)], ANY)[0]
    assert detected["boxes"].dtype == detected["scores"].dtype == torch.float64
    assert_same_boxes(
        {name: value.to(single[name].dtype) for name, value in detected.items()}, single
    )


@pytest.mark.parametrize("network", OTHERS)
def test_folded_batch_norm_predicts_the_same(network):
    model = tiny(network)
    fold_batch_norm(model)
    assert not any(isinstance(layer, torch.nn.BatchNorm2d) for layer in model.modules())
    assert_same_boxes(model.predict([cloud(3000)], ANY)[0], awake(network)[1])


@pytest.mark.parametrize("network", OTHERS)
def test_mixed_precision_trains(network):
    with torch.autocast("cpu", dtype=torch.bfloat16):
        assert_trains(tiny(network), [cloud(3000)], [objects()])


@pytest.mark.parametrize("network", OTHERS)
def test_the_seed_fixes_a_step_and_prediction_needs_none(network):
    losses, detected = [], []
    for _ in range(2):
        model = tiny(network)
        torch.manual_seed(1)
        losses.append(model.loss([cloud(3000)], *([item] for item in objects()))["loss"].item())
        torch.manual_seed(len(losses))
        detected.append(model.predict([cloud(3000)], ANY)[0])
    assert losses[0] == losses[1]
    assert len(detected[0]["boxes"]) > 0
    for key, value in detected[0].items():
        assert torch.equal(value, detected[1][key])


@pytest.mark.parametrize("network", OTHERS)
def test_only_the_classes_asked_for_have_anchors_and_heads(network):
    both, one = tiny(network), build_detector(network, ["Car"], preset="tiny")
    assert sum(p.numel() for p in one.parameters()) < sum(p.numel() for p in both.parameters())
    if hasattr(one, "dense_head"):
        assert one.dense_head.anchors.shape[2] * 3 == both.dense_head.anchors.shape[2]
    detected = one.predict([cloud(3000)], ANY)[0]
    assert len(detected["labels"]) > 0
    assert (detected["labels"] == 1).all()


def test_vector_math_is_settled_before_a_network_can_run():
    """MKL has chosen its kernels; the race itself is too rare to test."""
    settle_vector_math.cache_clear()
    build_detector("pointpillars_tiny", ["Car"])
    assert settle_vector_math.cache_info().currsize == 1


OWN = (0.0, -40.0, -3.0, 70.4, 40.0, 1.0)
ROI = (0.0, -20.0, -0.5, 40.0, 20.0, 4.0)


def test_heights_follow_the_roi_in_the_ego_frame_only():
    assert fitted_range(OWN, 1.73, None) == OWN
    assert fitted_range(OWN, 1.73, ROI) == (0, -20, -3, 40, 20, 1)
    assert fitted_range(OWN, 0.0, ROI) == ROI


lengths = st.floats(0.5, 200)


@given(lengths, lengths, lengths, st.floats(0.05, 3.2), st.floats(0.05, 0.5))
def test_ranges_grow_by_less_than_a_cell_to_whole_cells(x, y, z, edge, height):
    wanted = (1.0, -7.0, -1.0, 1.0 + x, -7.0 + y, -1.0 + z)
    fitted = fitted_range(OWN, 0.0, wanted, (edge, edge, height))
    assert fitted[:3] == wanted[:3]
    for axis, cell in enumerate((edge, edge, height)):
        cells = (fitted[3 + axis] - fitted[axis]) / cell
        assert cells == pytest.approx(round(cells), abs=1e-6)
        assert -1e-5 * cell < fitted[3 + axis] - wanted[3 + axis] < cell


def test_rounding_adds_no_cell():
    assert fitted_range(OWN, 0.0, (0.0, 0.0, 0.0, 0.3, 0.7, 1.0), (0.1, 0.1))[3:] == pytest.approx(
        (0.3, 0.7, 1.0)
    )


@pytest.mark.parametrize("network", NETWORKS)
@pytest.mark.parametrize("preset", ["openpcdet", "paper"])
def test_weights_fit_whatever_the_roi(network, preset):
    default = build_detector(network, ["Car"], preset=preset)
    other = build_detector(network, ["Car"], preset=preset, point_range=(5, -9, -2, 33, 9, 7.3))
    assert other.point_range[:2] == (5, -9)
    assert (other.point_range[2], other.point_range[5]) == (-3, 1)
    shapes = {key: value.shape for key, value in default.state_dict().items()}
    assert {key: value.shape for key, value in other.state_dict().items()} == shapes
