"""Networks and training on a GPU against the CPU.

Everything runs on the device that stands for a GPU, and where there is one, on that as well.
"""

import copy
from dataclasses import replace
from functools import cache

import pandas as pd
import pytest
import torch

from tests.training.other_device import MEMORY, WAITS, other_device
from tests.training.synthetic_scenes import scenes
from tests.training.test_overfit import LIKE_ANOTHER
from training import NETWORKS, build_detector
from training.batch_size import MEMORY_SHARE, batch_size_for, step_bytes
from training.dataset import TrainingFrames, as_tensors
from training.detect import detect
from training.detectors.detector import Selection
from training.finetune import TrainingContext, finetune
from training.ops.gpu import rotated_iou
from training.optimisation import Optimisation
from training.settings import TrainingSettings

pytestmark = pytest.mark.usefixtures("one_thread")

CPU = torch.device("cpu")
SOME, MORE = (
    [pytest.param(name, marks=pytest.mark.long if name in left_out else ()) for name in NETWORKS]
    for left_out in (LIKE_ANOTHER | {"second_iou"}, LIKE_ANOTHER - {"voxel_rcnn"})
)
NEEDS_GPU = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA GPU")


@pytest.fixture(autouse=True)
def on_cpu():
    """Overrides the fixture that keeps other tests on the CPU."""


@pytest.fixture
def other(monkeypatch, large_blocks):
    """The device that stands for a GPU; what a test changes of its memory is undone."""
    monkeypatch.setattr(MEMORY, "total", MEMORY.total)
    monkeypatch.setattr(rotated_iou, "_ROWS", 256)  # a program takes milliseconds on a CPU
    with other_device() as place:
        run_on(place, monkeypatch)
        yield place


@pytest.fixture(params=["other", pytest.param("cuda", marks=NEEDS_GPU)])
def device(request):
    """Device of the networks, not the CPU."""
    if request.param == "other":
        yield request.getfixturevalue("other")
    else:
        # Convolutions on a GPU round their input to 10 bits unless told not to.
        with torch.backends.cudnn.flags(enabled=True, allow_tf32=False):
            yield torch.device(request.param)


def run_on(place, monkeypatch):
    for module in ("detect", "finetune"):
        monkeypatch.setattr(f"training.{module}.device", lambda: place)


def assert_close(ours, expected, tolerance):
    error = tolerance if ours.is_floating_point() else 0
    torch.testing.assert_close(ours.detach().cpu(), expected.detach(), rtol=error, atol=error)


@cache
def some_frames(dtype=torch.float32):
    clouds, truth = scenes(2, seed=0, objects=8, fewest=6)
    frames = TrainingFrames(["Car"], clouds, truth, 0.0, min_points=1)
    points, boxes, labels = as_tensors([frames[0], frames[1]])
    return points, [item.to(dtype) for item in boxes], labels


def untrained(network):
    """A tiny network; few points and RoIs, as the GPU's searches are slow on a CPU."""
    torch.manual_seed(0)
    model = build_detector(network, ["Car"], preset="tiny")
    if hasattr(model, "roi_head"):
        settings = model.roi_head.settings
        train, test = (
            replace(settings.train, pre=256, post=64),
            replace(settings.test, pre=256, post=8),
        )
        sampling = replace(settings.sampling, rois=4)
        model.roi_head.settings = replace(settings, train=train, test=test, sampling=sampling)
    if hasattr(model, "pfe"):
        model.pfe.keypoints = 24
    if hasattr(model, "points"):
        model.points, model.backbone_3d.SA_modules.places = 512, (32, 8)
        model.roi_head.SA_modules.places = (4,)
    return model


@cache
def trained(network):
    """After some steps: an untrained one sees little of the points."""
    model = untrained(network).train()
    optimisation = Optimisation(model, TrainingSettings(lr=0.003), steps=6)
    for _ in range(6):
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
@pytest.mark.parametrize("network", MORE)
def test_networks_are_those_of_the_cpu(network, dtype, device):
    """One step and the best boxes of a trained network."""
    tolerance = TOLERANCES[device.type, dtype]
    on_cpu, on_device = (
        copy.deepcopy(trained(network)).to(place, dtype) for place in (CPU, device)
    )
    best, more = (Selection(score=0.0, nms=0.5, pre=256, post=count) for count in (5, 10))
    points = [item.to(device) for item in some_frames()[0]]  # where they are does not matter
    for ours, expected in zip(
        on_device.predict(points, more), on_cpu.predict(points, best), strict=True
    ):
        assert ours["boxes"].device.type == device.type
        assert len(expected["boxes"]) == 5
        # Scores that are alike but for rounding may change places.
        nearest = torch.cdist(expected["boxes"], ours["boxes"].cpu()).argmin(dim=1)
        for name in ("boxes", "scores", "labels"):
            assert_close(ours[name].cpu()[nearest], expected[name], tolerance)
    (losses, norms), (expected_losses, expected_norms) = step(on_device, dtype), step(on_cpu, dtype)
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
    losses, detected, few = [], [], Selection(score=0.0, pre=100, post=3)
    for place in (CPU, device):
        model = copy.deepcopy(trained(network)).to(place)
        torch.manual_seed(1)
        parts = model.loss(points, boxes, labels)
        losses.append({key: value.item() for key, value in parts.items()})
        detected.append([len(frame["boxes"]) for frame in model.predict(points, few)])
    assert losses[1] == pytest.approx(losses[0], rel=1e-2, abs=1e-3)
    assert detected[1] == detected[0]


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
        detected = model.predict(some_frames()[0], Selection(score=0.0, pre=100, post=50))
    for frame in detected:
        assert len(frame["boxes"]) > 0
        assert all(torch.isfinite(value).all() for value in frame.values())


@pytest.mark.parametrize(
    ("network", "predicts", "trains"), [("pointrcnn", 1, 1), ("pv_rcnn", 6, 6)]
)
def test_the_host_waits_for_a_gpu_as_rarely_as_now(network, predicts, trains, other):
    """Two frames; a change that needs fewer waits lowers the numbers."""
    model = untrained(network).to(other)
    WAITS.clear()
    model.predict(some_frames()[0])
    assert len(WAITS) <= predicts, WAITS
    model.train()
    WAITS.clear()
    model.loss(*some_frames())["loss"].backward()
    assert len(WAITS) <= trains, WAITS


# Training


def some_training():
    """Clouds, ground truth and the frames of both."""
    clouds, truth = scenes(3, seed=0)
    return clouds, truth, TrainingFrames(["Car"], clouds, truth, 0.0, min_points=1)


def test_training(device):
    """One step with 16-bit floats."""
    frames = some_training()[2]
    model = build_detector("second_tiny", ["Car"]).to(device)
    settings = TrainingSettings(mixed_precision=True)
    before = {name: value.clone() for name, value in model.named_parameters()}
    losses = Optimisation(model.train(), settings, steps=1).step(as_tensors([frames[0], frames[1]]))
    assert all(torch.isfinite(value) for value in losses.values())
    assert all(torch.isfinite(p).all() for p in model.parameters())
    assert any(not torch.equal(p, before[name]) for name, p in model.named_parameters())


def test_float16_where_there_is_no_bfloat16(other, monkeypatch):
    """The scaler leaves out steps until its scale is low enough."""
    monkeypatch.setattr(MEMORY, "bfloat16", False)
    frames = some_training()[2]
    model = build_detector("pointpillars_tiny", ["Car"]).to(other).train()
    before = {name: value.clone() for name, value in model.named_parameters()}
    optimisation, again = (Optimisation(model, TrainingSettings(), steps=20) for _ in range(2))
    for _ in range(20):
        losses = optimisation.step(as_tensors([frames[0]]))
        assert all(torch.isfinite(value) for value in losses.values())
        if any(not torch.equal(p, before[name]) for name, p in model.named_parameters()):
            break
    else:
        pytest.fail("no step changed a weight")
    assert all(torch.isfinite(p).all() for p in model.parameters())
    again.load_state_dict(optimisation.state_dict())
    assert again.state_dict()["scaler"] == optimisation.state_dict()["scaler"]
    assert again.state_dict()["scaler"]["scale"] < 65536


def test_the_batch_is_what_the_memory_holds(other):
    frames = some_training()[2]
    model = build_detector("pointpillars_tiny", ["Car"]).to(other)
    settings = TrainingSettings(batch_size="auto")
    taken = MEMORY.taken
    one, two, four = (step_bytes(model, frames, settings, size) for size in (1, 2, 4))
    assert MEMORY.taken == taken, "a trial must leave no memory taken"
    assert 0 < one < two < four
    before = copy.deepcopy(model.state_dict())
    for total, size in ((round((two + four) / 2 / MEMORY_SHARE), 2), ((one + two) // 2, 1)):
        MEMORY.total = taken + total
        assert batch_size_for(model, frames, settings) == size
    assert step_bytes(model, frames, settings, 2) is None
    for name, value in model.state_dict().items():
        assert torch.equal(value, before[name]), "a trial must leave the network alone"


@pytest.mark.parametrize(
    "detector", ["second_tiny", pytest.param("pv_rcnn_tiny", marks=pytest.mark.long)]
)
def test_a_training_moves_between_devices(detector, device, tmp_path, monkeypatch):
    """A training that was stopped goes on elsewhere, to what one on the CPU alone gives."""

    def stop(epochs):
        if epochs > 1:
            raise InterruptedError

    clouds, truth, _ = some_training()
    # Adam's first steps have the size of lr, also where a gradient is rounding alone.
    settings = TrainingSettings(batch_size=3, epochs=2, mixed_precision=False, lr=1e-4)
    tolerance = TOLERANCES[device.type, torch.float32]
    run_on(CPU, monkeypatch)
    expected = finetune(detector, ["Car"], clouds, truth, settings, 0)
    for first, then in ((device, CPU), (CPU, device)):
        folder = tmp_path / first.type
        run_on(first, monkeypatch)
        stopped = TrainingContext(folder=folder, on_step=stop)
        with pytest.raises(InterruptedError):
            finetune(detector, ["Car"], clouds, truth, settings, 0, stopped)
        run_on(then, monkeypatch)
        result = finetune(
            detector, ["Car"], clouds, truth, settings, 0, TrainingContext(folder=folder)
        )
        assert all(value.device == CPU for value in result.state_dict.values())
        curves = (item.curve.set_index(["epoch", "metric"])["value"] for item in (result, expected))
        ours, wanted = (curve.drop("seconds", level="metric") for curve in curves)
        assert len(ours) > 8
        pd.testing.assert_series_equal(ours, wanted, rtol=tolerance, atol=tolerance)


def test_detections_are_tables_wherever_they_were_made(device, monkeypatch):
    clouds, settings = some_training()[0], TrainingSettings(score_threshold=0.02)
    state, tables = trained("pv_rcnn").state_dict(), []
    for place in (CPU, device):
        run_on(place, monkeypatch)
        tables.append(detect("pv_rcnn_tiny", ["Car"], state, clouds, settings))
    tolerance = TOLERANCES[device.type, torch.float32]
    for name in ("boxes", "refined"):
        expected, ours = (getattr(table, name) for table in tables)
        assert len(expected) > 0
        pd.testing.assert_frame_equal(ours, expected, rtol=tolerance, atol=tolerance)
