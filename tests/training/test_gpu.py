"""Operations, networks and training on a GPU against the CPU.

Everything runs on the device that stands for a GPU, and where there is one, on that as well.
"""

import copy
from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest
import torch
from other_device import MEMORY, other_device
from synthetic_scenes import scenes
from test_overfit import LIKE_ANOTHER

from training import NETWORKS, build_detector
from training.batch_size import MEMORY_SHARE, batch_size_for, step_bytes
from training.checkpoints import load_checkpoint, write_checkpoint
from training.dataset import TrainingFrames, as_tensors
from training.detect import detect
from training.detectors.detector import Selection
from training.finetune import finetune
from training.ops.ball_query import ball_query
from training.ops.box_overlap import iou_3d, iou_bev
from training.ops.grouping import group
from training.ops.interpolation import interpolate, inverse_distance_weights, three_nn
from training.ops.nms import nms
from training.ops.points_in_boxes import box_of_points
from training.ops.roipoint_pool import roipoint_pool
from training.ops.sampling import furthest_point_sample
from training.ops.sparse_conv import SparseConv3d, SparseTensor, SubmanifoldConv3d
from training.ops.voxel_query import voxel_query
from training.optimisation import Optimisation
from training.settings import TrainingSettings

pytestmark = pytest.mark.usefixtures("one_thread")

CPU = torch.device("cpu")
SOME = [
    pytest.param(name, marks=pytest.mark.long if name in LIKE_ANOTHER else ()) for name in NETWORKS
]
NEEDS_GPU = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA GPU")
GEOMETRY = (2, 2, 2), (2, 2, 2), (0, 0, 0)
SHAPE = (6, 20, 20)


@pytest.fixture(autouse=True)
def on_cpu():
    """Overrides the fixture that keeps other tests on the CPU."""


@pytest.fixture(params=["other", pytest.param("cuda", marks=NEEDS_GPU)])
def device(request, monkeypatch):
    """Where networks run; not the CPU."""
    if request.param == "other":
        with other_device() as place:
            run_on(place, monkeypatch)
            yield place
    else:
        # Convolutions on a GPU round their input to 10 bits unless told not to.
        with torch.backends.cudnn.flags(enabled=True, allow_tf32=False):
            yield torch.device(request.param)


@pytest.fixture
def other(monkeypatch):
    """The device that stands for a GPU; what a test changes of its memory is undone."""
    monkeypatch.setattr(MEMORY, "total", MEMORY.total)
    with other_device() as place:
        run_on(place, monkeypatch)
        yield place


def run_on(place, monkeypatch):
    for module in ("detect", "finetune"):
        monkeypatch.setattr(f"training.{module}.device", lambda: place)


# Operations: each takes a device, puts the same random input there, and returns its results.


def uniform(low, high, count, seed=0):
    random = np.random.default_rng(seed)
    return torch.from_numpy(random.uniform(low, high, (count, len(low))).astype(np.float32))


def some_points(count, device, seed=0):
    """Points (count, 3) of two frames, and how many each has."""
    xyz = uniform((0, 0, 0), (10, 10, 3), count, seed)
    return xyz.to(device), torch.tensor([count // 3, count - count // 3], device=device)


def some_boxes(count, device, seed=0):
    low, high = (0, 0, 0, 0.5, 0.5, 0.5, -7), (10, 10, 3, 4, 2, 2, 7)
    return uniform(low, high, count, seed).to(device)


def some_voxels(device, channels=8):
    random = torch.Generator().manual_seed(0)
    coordinates = torch.nonzero(torch.rand(2, *SHAPE, generator=random) < 0.2)
    features = torch.randn(len(coordinates), channels, generator=random)
    return SparseTensor(features.to(device), coordinates.to(device), SHAPE, frames=2)


def sampled(device):
    return furthest_point_sample(*some_points(3000, device), 200)


def in_balls(device):
    return ball_query(1.0, 16, *some_points(3000, device), *some_points(500, device, seed=1))


def in_voxels(device):
    voxels = some_voxels(device)
    edge = 0.5
    places = (voxels.coordinates[:, [3, 2, 1]] + 0.5) * edge
    new = uniform((0, 0, 0), (10, 10, 3), 500).to(device)
    cells = torch.div(new[:, [2, 1, 0]], edge, rounding_mode="floor").long()
    frame = torch.arange(len(new), device=device)[:, None] % 2
    return voxel_query(
        (2, 2, 2), 1.1, 16, places, voxels.coordinates, SHAPE, new, torch.cat([frame, cells], dim=1)
    )


def interpolated(device):
    unknown, known = some_points(3000, device), some_points(500, device, seed=1)
    distances, idx = three_nn(*unknown, *known)
    features = known[0].clone().requires_grad_()
    result = interpolate(features, idx, inverse_distance_weights(distances))
    return distances, idx, result, *torch.autograd.grad(result.square().sum(), features)


def grouped(device):
    features = some_points(500, device)[0].requires_grad_()
    idx = torch.arange(8000, device=device).view(1000, 8) % 499
    result = group(features, idx)
    return result, *torch.autograd.grad(result.square().sum(), features)


def pooled(device):
    points = some_points(3000, device)[0]
    features = points.sin().requires_grad_()
    result, empty = roipoint_pool(points, features, some_boxes(40, device), 64, 0.4)
    return result, empty, *torch.autograd.grad(result.square().sum(), features)


def boxes_of_points(device):
    return (box_of_points(some_points(3000, device)[0], some_boxes(40, device)),)


def overlaps(device):
    a, b = some_boxes(60, device), some_boxes(80, device, seed=1)
    return iou_bev(a, b), iou_3d(a, b)


def unsuppressed(device):
    boxes = some_boxes(600, device)
    return tuple(nms(boxes, boxes[:, 0], threshold) for threshold in (0.01, 0.5, 0.8))


def convolved(device):
    """Two convolutions, and gradients of their input and weights."""
    torch.manual_seed(0)
    layers = (SubmanifoldConv3d(8, 16), SparseConv3d(16, 16, *GEOMETRY))
    same, down = (layer.to(device) for layer in layers)
    voxels = some_voxels(device)
    features = voxels.features.requires_grad_()
    fine = same(voxels)
    coarse = down(fine)
    loss = coarse.features.square().mean() + coarse.dense().sum() / 1000 + coarse.bev().mean()
    weights = [layer.weight for layer in layers]
    gradients = torch.autograd.grad(loss, [features, *weights])
    return fine.features, coarse.features, coarse.coordinates, *gradients


OPERATIONS = (
    sampled,
    in_balls,
    in_voxels,
    interpolated,
    grouped,
    pooled,
    boxes_of_points,
    overlaps,
    unsuppressed,
    convolved,
)


def assert_close(found, expected, tolerance):
    assert found.dtype == expected.dtype
    exact = not found.is_floating_point()
    torch.testing.assert_close(
        found.detach().cpu(),
        expected.detach(),
        rtol=0 if exact else tolerance,
        atol=0 if exact else tolerance,
    )


@pytest.mark.parametrize("operation", OPERATIONS)
def test_operations_are_those_of_the_cpu(operation, device):
    for found, expected in zip(operation(device), operation(CPU), strict=True):
        assert found.device.type == device.type
        assert expected.numel() > 0
        assert_close(found, expected, 1e-5)


# Networks


def some_frames(dtype=torch.float32):
    clouds, truth = scenes(2, seed=0, objects=8, fewest=6)
    points, boxes, labels = as_tensors(
        [TrainingFrames(["Car"], clouds, truth, 0.0, min_points=1)[i] for i in range(2)]
    )
    return points, [item.to(dtype) for item in boxes], labels


def untrained(network):
    """A tiny network; few RoIs, as the GPU's searches are slow on a CPU."""
    torch.manual_seed(0)
    model = build_detector(network, ["Car"], preset="tiny")
    if hasattr(model, "roi_head"):
        settings = model.roi_head.settings
        model.roi_head.settings = replace(
            settings,
            train=replace(settings.train, pre=256, post=64),
            test=replace(settings.test, pre=256, post=24),
            sampling=replace(settings.sampling, rois=16),
        )
    return model


@cache
def trained(network):
    """After some steps: an untrained one sees little of the points."""
    model = untrained(network).train()
    optimisation = Optimisation(model, TrainingSettings(lr=0.003), steps=10)
    for _ in range(10):
        optimisation.step(some_frames())
    return model


def step(model, dtype):
    """Losses, and the norms of their gradients."""
    torch.manual_seed(1)
    losses = model.train().loss(*some_frames(dtype))
    losses["loss"].backward()
    norms = {name: p.grad.norm() for name, p in model.named_parameters() if p.grad is not None}
    return {name: value.item() for name, value in losses.items()}, norms


TOLERANCES = {
    ("other", torch.float32): 1e-4,
    ("other", torch.float64): 1e-8,
    ("cuda", torch.float32): 1e-2,
    ("cuda", torch.float64): 1e-5,
}


@pytest.mark.parametrize(
    "dtype", [pytest.param(torch.float32, marks=pytest.mark.long), torch.float64]
)
@pytest.mark.parametrize("network", NETWORKS)
def test_networks_are_those_of_the_cpu(network, dtype, device):
    """One step and the best boxes of a trained network."""
    tolerance = TOLERANCES[device.type, dtype]
    here, there = (copy.deepcopy(trained(network)).to(place, dtype) for place in (CPU, device))
    best, more = (Selection(score=0.0, nms=0.5, pre=256, post=count) for count in (5, 10))
    points = some_frames()[0]
    if dtype == torch.float32:  # where they lie does not matter
        points = [item.to(device) for item in points]
    for found, expected in zip(
        there.predict(points, more), here.predict(points, best), strict=True
    ):
        assert found["boxes"].device.type == device.type
        assert len(expected["boxes"]) == 5
        # Scores that are alike but for rounding may change places.
        nearest = torch.cdist(expected["boxes"], found["boxes"].cpu()).argmin(dim=1)
        for name in ("boxes", "scores", "labels"):
            assert_close(found[name].cpu()[nearest], expected[name], tolerance)
    (losses, norms), (expected_losses, expected_norms) = step(there, dtype), step(here, dtype)
    assert losses == pytest.approx(expected_losses, rel=tolerance, abs=tolerance)
    assert norms.keys() == expected_norms.keys()
    largest = max(expected_norms.values()).item()
    for name, value in norms.items():
        assert value.item() == pytest.approx(
            expected_norms[name].item(), rel=10 * tolerance, abs=tolerance * largest
        ), name


@pytest.mark.parametrize("network", SOME)
def test_frames_without_points_or_objects(network, device):
    points, boxes, labels = some_frames()
    points = [points[0], points[0][:0], torch.full((5, 4), torch.nan), points[1]]
    boxes = [boxes[0], boxes[0][:0], boxes[1], boxes[1][:0]]
    labels = [labels[0], labels[0][:0], labels[1], labels[1][:0]]
    losses, found, few = [], [], Selection(score=0.0, pre=100, post=3)
    for place in (CPU, device):
        model = copy.deepcopy(trained(network)).to(place)
        torch.manual_seed(1)
        losses.append(
            {key: value.item() for key, value in model.loss(points, boxes, labels).items()}
        )
        found.append([len(frame["boxes"]) for frame in model.predict(points, few)])
    assert losses[1] == pytest.approx(losses[0], rel=1e-2, abs=1e-3)
    assert found[1] == found[0]


@pytest.mark.parametrize("network", SOME)
def test_mixed_precision(network, device):
    """Losses and gradients are finite, and so are the boxes."""
    model = untrained(network).to(device)
    with torch.autocast(device.type, dtype=torch.bfloat16):
        losses = model.train().loss(*some_frames())
    assert losses["loss"].dtype == torch.float32
    losses["loss"].backward()
    for value in (*losses.values(), *(p.grad for p in model.parameters() if p.grad is not None)):
        assert torch.isfinite(value).all()
    with torch.autocast(device.type, dtype=torch.bfloat16):
        found = model.predict(some_frames()[0], Selection(score=0.0, pre=100, post=50))
    for frame in found:
        assert len(frame["boxes"]) > 0
        assert all(torch.isfinite(value).all() for value in frame.values())


# Training


def some_training():
    """Clouds, ground truth and the frames of both."""
    clouds, truth = scenes(3, seed=0)
    return clouds, truth, TrainingFrames(["Car"], clouds, truth, 0.0, min_points=1)


def test_training(device):
    """A batch size, and one step with 16-bit floats."""
    frames = some_training()[2]
    model = build_detector("second_tiny", ["Car"]).to(device)
    settings = TrainingSettings(batch_size="auto", mixed_precision=True)
    before = {name: value.clone() for name, value in model.state_dict().items()}
    # Of the device that stands for a GPU a millionth is what two frames need.
    share = 1.0 if device.type == "cuda" else 1e-6
    assert batch_size_for(model, frames, settings, share) in (1, 2, 4, 8, 16)
    for name, value in model.state_dict().items():
        assert torch.equal(value, before[name]), "a trial must leave the network alone"
    losses = Optimisation(model.train(), settings, steps=1).step(as_tensors([frames[0], frames[1]]))
    assert all(torch.isfinite(value) for value in losses.values())
    assert all(torch.isfinite(p).all() for p in model.parameters())
    assert any(not torch.equal(p, before[name]) for name, p in model.named_parameters())


def test_float16_where_there_is_no_bfloat16(other, monkeypatch):
    """The scaler leaves out steps until its scale is low enough."""
    monkeypatch.setattr(MEMORY, "bfloat16", False)
    frames = some_training()[2]
    model = build_detector("second_tiny", ["Car"]).to(other).train()
    before = {name: value.clone() for name, value in model.named_parameters()}
    optimisation = Optimisation(model, TrainingSettings(mixed_precision=True), steps=20)
    for _ in range(20):
        losses = optimisation.step(as_tensors([frames[0]]))
        assert all(torch.isfinite(value) for value in losses.values())
        if any(not torch.equal(p, before[name]) for name, p in model.named_parameters()):
            break
    else:
        pytest.fail("no step changed a weight")
    assert all(torch.isfinite(p).all() for p in model.parameters())
    scaler = optimisation.state_dict()["scaler"]
    again = Optimisation(model, TrainingSettings(mixed_precision=True), steps=20)
    again.load_state_dict(optimisation.state_dict())
    assert again.state_dict()["scaler"] == scaler
    assert scaler["scale"] < 65536


def test_the_batch_is_what_the_memory_holds(other):
    frames = some_training()[2]
    model = build_detector("second_tiny", ["Car"]).to(other)
    settings = TrainingSettings(batch_size="auto")
    taken = MEMORY.taken
    one, two, four = (step_bytes(model, frames, settings, size) for size in (1, 2, 4))
    assert MEMORY.taken == taken, "a trial must leave no memory taken"
    assert 0 < one < two < four
    MEMORY.total = taken + round((two + four) / 2 / MEMORY_SHARE)
    assert batch_size_for(model, frames, settings) == 2
    assert batch_size_for(model, frames, settings, gpu_share=one / two) == 1
    MEMORY.total = taken + (one + two) // 2
    assert step_bytes(model, frames, settings, 2) is None
    assert batch_size_for(model, frames, settings) == 1
    MEMORY.total = taken + one // 2
    assert batch_size_for(model, frames, settings) == 1
    model.cpu()
    assert step_bytes(model, frames, settings, 1) == 0


@pytest.mark.parametrize("detector", ["second_tiny", "pv_rcnn_tiny"])
def test_a_training_moves_between_devices(detector, device, tmp_path, monkeypatch):
    """A training that was stopped goes on elsewhere, to what one on the CPU alone gives."""

    def stop(values):
        raise InterruptedError

    clouds, truth, _ = some_training()
    settings = TrainingSettings(batch_size=3, epochs=2, mixed_precision=False)
    tolerance = TOLERANCES[device.type, torch.float32]
    run_on(CPU, monkeypatch)
    expected = finetune(detector, ["Car"], clouds, truth, settings, 0)
    for first, then in ((device, CPU), (CPU, device)):
        folder = tmp_path / first.type
        run_on(first, monkeypatch)
        with pytest.raises(InterruptedError):
            finetune(detector, ["Car"], clouds, truth, settings, 0, folder=folder, on_epoch=stop)
        run_on(then, monkeypatch)
        result = finetune(detector, ["Car"], clouds, truth, settings, 0, folder=folder)
        assert all(value.device == CPU for value in result.state_dict.values())
        curves = (item.curve.set_index(["epoch", "metric"])["value"] for item in (result, expected))
        found, wanted = (curve.drop("seconds", level="metric") for curve in curves)
        assert len(found) > 8
        pd.testing.assert_series_equal(found, wanted, rtol=tolerance, atol=tolerance)


def test_detections_are_tables_wherever_they_were_made(device, monkeypatch):
    clouds, settings = some_training()[0], TrainingSettings(score_threshold=0.02)
    tables = []
    for place in (CPU, device):
        run_on(place, monkeypatch)
        state = trained("pv_rcnn").state_dict()
        tables.append(detect("pv_rcnn_tiny", ["Car"], state, clouds, settings))
    tolerance = TOLERANCES[device.type, torch.float32]
    for name in ("boxes", "refined"):
        expected, found = (getattr(table, name) for table in tables)
        assert len(expected) > 0
        pd.testing.assert_frame_equal(found, expected, rtol=tolerance, atol=tolerance)


def test_a_checkpoint_is_of_no_device(device, tmp_path):
    trained_there = copy.deepcopy(trained("second")).to(device)
    expected = trained("second").state_dict()
    write_checkpoint(tmp_path / "a.pt", trained_there.state_dict(), "second_tiny", ["Car"])
    for place in (CPU, device):
        model = build_detector("second_tiny", ["Car"]).to(place)
        report = load_checkpoint(model, tmp_path / "a.pt")
        assert len(report.loaded) == len(expected)
        for name, value in model.state_dict().items():
            assert value.device.type == place.type
            assert torch.equal(value.cpu(), expected[name])
