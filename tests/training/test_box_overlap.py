"""Overlap of boxes as tensors: the path for GPUs against numba's exact clipping."""

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from training.ops import box_overlap, rotated_iou

DATA = np.load(Path(__file__).parents[1] / "data" / "training_ops.npz")
IOU = [(box_overlap.iou_bev, rotated_iou.iou_bev), (box_overlap.iou_3d, rotated_iou.iou_3d)]


def box(x=0.0, y=0.0, z=0.0, length=4.0, width=2.0, height=1.5, yaw=0.0):
    return [x, y, z, length, width, height, yaw]


# Whole and half numbers and right angles make boxes that touch, coincide or have no area.
boxes = st.lists(
    st.tuples(
        *[st.floats(-3, 3) | st.integers(-3, 3).map(float)] * 3,
        *[st.floats(0, 6) | st.integers(0, 3).map(float)] * 3,
        st.floats(-7, 7) | st.sampled_from([0.0, math.pi / 2, math.pi, math.pi / 4]),
    ),
    max_size=5,
)


@pytest.mark.usefixtures("last_bits")
@settings(max_examples=100)
@given(boxes, boxes, st.booleans())
def test_clipping_at_once_agrees_with_one_by_one(a, b, three_d):
    a, b = (torch.tensor(rows, dtype=torch.float64).view(-1, 7) for rows in (a, b))
    a, b = torch.cat([a, b[:1]]), torch.cat([b, a[:1]])
    expected = IOU[three_d][1](a.numpy(), b.numpy())
    assert box_overlap._iou_torch(a, b, three_d).numpy() == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("three_d", [False, True])
def test_agrees_with_openpcdet_in_pieces(three_d, monkeypatch):
    a, b = torch.from_numpy(DATA["a"]), torch.from_numpy(DATA["b"])
    whole = box_overlap._iou_torch(a, b, three_d)
    assert np.abs(whole.numpy() - DATA["iou_3d" if three_d else "iou_bev"]).max() < 5e-3
    monkeypatch.setattr(box_overlap, "_CHUNK", 1000)
    monkeypatch.setattr(box_overlap, "_CLIPPED", 7)
    assert torch.equal(box_overlap._iou_torch(a, b, three_d), whole)


@pytest.mark.usefixtures("last_bits")
@pytest.mark.parametrize("angle", [0.0, 1e-16, 1e-12, 1e-9, 1e-6])
@pytest.mark.parametrize("far", [0.0, 1e3, 1e7])
def test_a_box_overlaps_itself_completely(angle, far):
    a = torch.tensor([box(x=far, y=-far, yaw=0.7)], dtype=torch.float64)
    b = a + torch.tensor([0, 0, 0, 0, 0, 0, angle], dtype=torch.float64)
    # Four triangles stick out; see test_rotated_iou.py.
    lost = 2 * (4**2 + 2**2) * angle / 4 / 8
    assert box_overlap._iou_torch(a, b, False).item() == pytest.approx(1 - lost, abs=1e-11)


@pytest.mark.parametrize(("iou", "expected"), IOU)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_tensors_in_tensors_out(iou, expected, dtype):
    a = torch.tensor([box(), box(x=1.0), box(z=9.0)], dtype=dtype, requires_grad=True)
    result = iou(a, a[1:])
    assert result.dtype == dtype
    assert not result.requires_grad
    values = a.detach().numpy()
    assert torch.equal(result, torch.from_numpy(expected(values, values[1:])).to(dtype))
    assert iou(a[:0], a).shape == (0, 3)
    assert iou(a, a[:0]).shape == (3, 0)
    assert box_overlap._iou_torch(a[:0], a, False).shape == (0, 3)
    assert box_overlap._iou_torch(a, a[:0], False).shape == (3, 0)


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (torch.zeros(2, 6), r"shape \(N, 7\).*found \(2, 6\)"),
        (torch.tensor([box(x=math.nan)]), "finite"),
        (torch.tensor([box(yaw=math.inf)]), "finite"),
        (torch.tensor([box(width=-1.0)]), "at least 0, found -1"),
    ],
)
def test_bad_boxes_on_either_path(bad, message):
    good = torch.tensor([box()])
    for iou in (box_overlap.iou_bev, lambda a, b: box_overlap._iou_torch(a, b, False)):
        with pytest.raises(ValueError, match=message):
            iou(bad, good)
        with pytest.raises(ValueError, match=message):
            iou(good, bad)
