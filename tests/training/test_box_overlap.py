"""Overlap of rotated boxes on a CPU and a GPU: closed forms, other algorithms, OpenPCDet.

tests/data/training_ops.npz: inputs and outputs of OpenPCDet's CUDA kernels, recorded at
commit 8cacccec (Apache-2.0). Its IoU kernel pads boxes by 1e-2 m when it looks for corners
inside, so it differs from the exact IoU by up to 3.7e-3.
"""

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from tests.refused import refused
from training.ops import box_overlap
from training.ops.gpu import rotated_iou as kernels
from training.ops.rotated_iou import iou_3d, iou_bev, paired_iou

DATA = np.load(Path(__file__).parents[1] / "data" / "training_ops.npz")


def on_gpu(a, b, three_d):
    """The GPU's kernel, which has volumes alone: boxes of one height for the overlap from above."""
    a, b = (np.array(boxes, np.float64) for boxes in (a, b))
    if not three_d:
        a[:, [2, 5]] = b[:, [2, 5]] = 1
    return kernels.iou_3d(torch.from_numpy(a)[None], torch.from_numpy(b)[None])[0].numpy()


def in_numba(a, b, three_d):
    return (iou_3d if three_d else iou_bev)(a, b)


BOTH = pytest.mark.parametrize("iou", [in_numba, on_gpu])


def box(x=0.0, y=0.0, z=0.0, length=4.0, width=2.0, height=1.5, yaw=0.0):
    return np.array([[x, y, z, length, width, height, yaw]])


sides, places = st.floats(0.1, 6), st.floats(-3, 3)
boxes = st.builds(box, places, places, st.floats(-1, 1), sides, sides, sides, st.floats(-7, 7))
# Whole and half numbers and right angles make boxes that touch, coincide or have no area.
crowds = st.lists(
    st.tuples(
        *[places | st.integers(-3, 3).map(float)] * 3,
        *[st.floats(0, 6) | st.integers(0, 3).map(float)] * 3,
        st.floats(-7, 7) | st.sampled_from([0.0, math.pi / 2, math.pi, math.pi / 4]),
    ),
    max_size=5,
).map(lambda rows: np.array(rows).reshape(-1, 7))


def turn(angle):
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])


def corners(item):
    signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) / 2
    return (signs * item[0, 3:5]) @ turn(item[0, 6]).T + item[0, :2]


def inside(points, item):
    local = (points - item[0, :2]) @ turn(item[0, 6])
    return (np.abs(local) <= item[0, 3:5] / 2 + 1e-12).all(axis=1)


def hull_area(a, b):
    """Area of the hull of corners inside the other box and of crossings of edges."""
    ca, cb = corners(a), corners(b)
    points = [*ca[inside(ca, b)], *cb[inside(cb, a)]]
    for p, r in zip(ca, np.roll(ca, -1, 0) - ca, strict=True):
        for q, s in zip(cb, np.roll(cb, -1, 0) - cb, strict=True):
            cross = r[0] * s[1] - r[1] * s[0]
            if abs(cross) < 1e-12:
                continue
            t = ((q - p)[0] * s[1] - (q - p)[1] * s[0]) / cross
            u = ((q - p)[0] * r[1] - (q - p)[1] * r[0]) / cross
            if 0 <= t <= 1 and 0 <= u <= 1:
                points.append(p + t * r)
    # QJ, joggled input, lets qhull take flat hulls; it costs it the last digits.
    return ConvexHull(np.array(points), qhull_options="QJ Pp").volume if len(points) > 2 else 0.0


@settings(max_examples=150)
@given(boxes, boxes)
def test_agrees_with_the_hull_of_crossings(a, b):
    common = hull_area(a, b)
    areas = a[0, 3] * a[0, 4] + b[0, 3] * b[0, 4]
    overlap = iou_bev(a, b)[0, 0]
    assert overlap * areas / (1 + overlap) == pytest.approx(common, abs=1e-6)


@pytest.mark.usefixtures("last_bits")
@settings(max_examples=40)
@given(crowds, crowds)
def test_the_gpu_agrees_with_the_cpu(a, b):
    a, b = np.concatenate([a, b[:1]]), np.concatenate([b, a[:1]])
    for three_d in (True, False):
        assert on_gpu(a, b, three_d) == pytest.approx(in_numba(a, b, three_d), abs=1e-12)


@pytest.mark.usefixtures("last_bits")
@BOTH
@pytest.mark.parametrize("angle", [0.0, 1e-16, 1e-12, 1e-9, 1e-6, math.pi])
@pytest.mark.parametrize("far", [0.0, 1e3, 1e7, 1e9])
def test_a_box_overlaps_itself_completely_wherever_it_is(iou, angle, far):
    a, b = (box(x=far, y=-far, yaw=0.7 + turned) for turned in (0, angle))
    # Each of the four corners that stick out is a triangle; see the first-order term.
    lost = 2 * (4**2 + 2**2) * angle / 4 / 8 if angle < 1 else 0
    assert iou(a, b, False)[0, 0] == pytest.approx(1 - lost, abs=1e-11)
    assert iou(a, b, True)[0, 0] == pytest.approx(1 - lost, abs=1e-11)


OCTAGON = 8 * (math.sqrt(2) - 1)  # two equal squares of 2 m, one turned by 45 degrees, share it
CLOSED_FORMS = [
    (box(length=2.0), box(length=2.0, yaw=math.pi / 4), False, OCTAGON / (8 - OCTAGON)),
    (box(), box(yaw=math.pi / 2), False, 4 / 12),  # a cross
    (box(), box(x=2.0), False, 1 / 3),
    (box(), box(x=2.0, z=0.75), True, 1 / 7),  # half a height higher
    (box(), box(length=1.0, width=1.0, height=1.0, yaw=0.3), True, 1 / 12),  # inside
    (box(yaw=0.3), box(x=math.cos(0.3), y=math.sin(0.3), length=2.0, yaw=0.3), False, 0.5),
    (box(width=1e-6), box(width=1e-6, yaw=math.pi / 2), False, 1e-12 / (8e-6 - 1e-12)),
    (box(width=1e-6, yaw=0.3), box(width=1e-6, yaw=0.3), False, 1),  # slivers
    (box(yaw=0.3), box(z=2.0, yaw=0.3), False, 1),
    (box(yaw=0.3), box(z=2.0, yaw=0.3), True, 0),  # above each other
    (box(), box(x=4.0), False, 0),  # they touch
    (box(), box(x=4.0, y=2.0), False, 0),
    (box(), box(z=1.5), True, 0),
    (box(length=0.0), box(), False, 0),  # without area or volume
    (box(length=0.0), box(length=0.0), False, 0),
    (box(height=0.0), box(height=0.0), True, 0),
]


@BOTH
@pytest.mark.parametrize(("a", "b", "three_d", "expected"), CLOSED_FORMS)
def test_closed_forms(iou, a, b, three_d, expected):
    assert iou(a, b, three_d)[0, 0] == pytest.approx(expected, rel=1e-13)


def test_agrees_with_openpcdet():
    a, b = DATA["a"], DATA["b"]
    assert np.abs(iou_bev(a, b) - DATA["iou_bev"]).max() < 5e-3
    assert (DATA["iou_bev"] > 0.3).sum() > 50
    frames = (torch.from_numpy(part)[None].repeat(2, 1, 1) for part in (a, b))
    for whole in kernels.iou_3d(*frames):
        assert np.abs(whole.numpy() - DATA["iou_3d"]).max() < 5e-3
        assert np.abs(whole.numpy() - iou_3d(a, b)).max() < 1e-6


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_tensors_in_tensors_out(dtype):
    rows = np.concatenate([box(), box(x=1.0), box(z=9.0)])
    a = torch.from_numpy(rows)[None].to(dtype).requires_grad_()
    result = box_overlap.iou_3d(a, a[:, 1:])
    assert result.dtype == dtype
    assert not result.requires_grad
    values = a.detach()[0].numpy()
    values.setflags(write=False)
    expected = iou_3d(values, values[1:])
    assert torch.equal(result[0], torch.from_numpy(expected).to(dtype))
    assert torch.equal(kernels.iou_3d(a.detach(), a[:, 1:].detach()), result)
    paired = paired_iou(values, values[::-1], three_d=True)
    assert paired == pytest.approx(iou_3d(values, values)[[0, 1, 2], [2, 1, 0]])
    for iou in (box_overlap.iou_3d, kernels.iou_3d):
        assert iou(a[:, :0].detach(), a.detach()).shape == (1, 0, 3)
        assert iou(a.detach(), a[:, :0].detach()).shape == (1, 3, 0)
        assert iou(a[:0].detach(), a[:0].detach()).shape == (0, 3, 3)


@pytest.mark.parametrize(
    ("bad", "found"),
    [
        (np.zeros((2, 6)), "(2, 6)"),
        (box(x=math.nan), "NaN or infinity"),
        (box(yaw=math.inf), "NaN or infinity"),
        (box(width=-1.0), "-1.0"),
    ],
)
def test_bad_boxes(bad, found):
    good, wrong = torch.from_numpy(box())[None], torch.from_numpy(bad)[None]
    for pair in ((good, wrong), (wrong, good)):
        with refused(("", "boxes", found)):
            box_overlap.iou_3d(*pair)
