"""Overlap of rotated boxes: closed forms, properties, another algorithm, OpenPCDet.

tests/data/training_ops.npz: inputs and outputs of OpenPCDet's CUDA kernels, recorded at
commit 8cacccec (Apache-2.0). Its IoU kernel pads boxes by 1e-2 m when it looks for corners
inside, so it differs from the exact IoU by up to 3.7e-3.
"""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from training.ops.rotated_iou import bev_overlap, iou_3d, iou_bev, paired_iou

DATA = Path(__file__).parents[1] / "data" / "training_ops.npz"


def box(x=0.0, y=0.0, z=0.0, length=4.0, width=2.0, height=1.5, yaw=0.0):
    return np.array([[x, y, z, length, width, height, yaw]])


boxes = st.builds(
    box,
    x=st.floats(-3, 3),
    y=st.floats(-3, 3),
    z=st.floats(-1, 1),
    length=st.floats(0.1, 6),
    width=st.floats(0.1, 6),
    height=st.floats(0.1, 3),
    yaw=st.floats(-7, 7),
)


def corners(item):
    x, y, _, length, width, _, yaw = item[0]
    signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) / 2
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    return (signs * [length, width]) @ turn.T + [x, y]


def inside(points, item):
    x, y, _, length, width, _, yaw = item[0]
    dx, dy = points[:, 0] - x, points[:, 1] - y
    u = math.cos(yaw) * dx + math.sin(yaw) * dy
    v = math.cos(yaw) * dy - math.sin(yaw) * dx
    return (np.abs(u) <= length / 2 + 1e-12) & (np.abs(v) <= width / 2 + 1e-12)


def hull_area(a, b):
    """Area of the hull of corners inside the other box and of crossings of edges."""
    ca, cb = corners(a), corners(b)
    points = [*ca[inside(ca, b)], *cb[inside(cb, a)]]
    for i in range(4):
        p, r = ca[i], ca[(i + 1) % 4] - ca[i]
        for j in range(4):
            q, s = cb[j], cb[(j + 1) % 4] - cb[j]
            cross = r[0] * s[1] - r[1] * s[0]
            if abs(cross) < 1e-12:
                continue
            t = ((q - p)[0] * s[1] - (q - p)[1] * s[0]) / cross
            u = ((q - p)[0] * r[1] - (q - p)[1] * r[0]) / cross
            if 0 <= t <= 1 and 0 <= u <= 1:
                points.append(p + t * r)
    if len(points) < 3:
        return 0.0
    return ConvexHull(np.array(points), qhull_options="QJ Pp").volume


@settings(max_examples=150)
@given(boxes, boxes)
def test_area_agrees_with_the_hull_of_crossings(a, b):
    # QJ, joggled input, lets qhull take flat hulls; it costs it the last digits.
    assert bev_overlap(a, b)[0, 0] == pytest.approx(hull_area(a, b), abs=1e-6)


def test_boxes_above_each_other_share_no_volume():
    a, above = ([[0.0, 0.0, z, 4.0, 2.0, 1.5, 0.3]] for z in (0.0, 2.0))
    assert iou_bev(a, above)[0, 0] == pytest.approx(1)
    assert iou_3d(a, above)[0, 0] == 0


@settings(max_examples=100)
@given(boxes, boxes, st.floats(-4, 4), st.floats(-50, 50), st.floats(-50, 50))
def test_symmetric_and_invariant_under_rigid_motion(a, b, angle, dx, dy):
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    moved = []
    for item in (a, b):
        item = item.copy()
        item[:, :2] = item[:, :2] @ turn.T + [dx, dy]
        item[:, 6] += angle
        moved.append(item)
    for iou in (iou_bev, iou_3d):
        value = iou(a, b)[0, 0]
        assert 0 <= value <= 1
        assert iou(b, a)[0, 0] == pytest.approx(value, abs=1e-12)
        assert iou(*moved)[0, 0] == pytest.approx(value, abs=1e-10)


@settings(max_examples=100)
@given(boxes, st.sampled_from([0.0, 1e3, 1e7, 1e9]))
def test_a_box_overlaps_itself_completely_wherever_it_is(a, far):
    a = a + np.array([far, -far, 0, 0, 0, 0, 0])
    assert iou_bev(a, a)[0, 0] == pytest.approx(1, abs=1e-14)
    assert iou_3d(a, a)[0, 0] == pytest.approx(1, abs=1e-14)
    turned = a + np.array([0, 0, 0, 0, 0, 0, math.pi])
    assert iou_bev(a, turned)[0, 0] == pytest.approx(1, abs=1e-13)


def test_closed_forms():
    square = box(length=2.0, width=2.0, height=2.0)
    # A unit octagon: two equal squares, one turned by 45 degrees.
    octagon = 8 * (math.sqrt(2) - 1)
    turned = box(length=2.0, width=2.0, height=2.0, yaw=math.pi / 4)
    assert bev_overlap(square, turned)[0, 0] == pytest.approx(octagon, rel=1e-14)
    # A cross of 4 × 2 boxes.
    assert iou_bev(box(), box(yaw=math.pi / 2))[0, 0] == pytest.approx(4 / 12, rel=1e-14)
    # Half a box further, half a height higher.
    assert iou_bev(box(), box(x=2.0))[0, 0] == pytest.approx(1 / 3, rel=1e-14)
    assert iou_3d(box(), box(x=2.0, z=0.75))[0, 0] == pytest.approx(1 / 7, rel=1e-14)
    # One inside the other.
    inner = box(length=1.0, width=1.0, height=1.0, yaw=0.3)
    assert iou_3d(box(), inner)[0, 0] == pytest.approx(1 / 12, rel=1e-14)


@pytest.mark.parametrize("angle", [1e-16, 1e-12, 1e-9, 1e-6, 1e-3])
def test_tiny_angles(angle):
    # Each of the four corners that stick out is a triangle; see the first-order term.
    lost = 1 - bev_overlap(box(), box(yaw=angle))[0, 0] / 8
    assert lost == pytest.approx((4**2 + 2**2) * angle / 4 / 8, rel=2e-3, abs=1e-14)


def test_touching_and_degenerate_boxes_share_nothing():
    assert iou_bev(box(), box(x=4.0))[0, 0] == 0
    assert iou_bev(box(), box(x=4.0, y=2.0))[0, 0] == 0
    assert iou_3d(box(), box(z=1.5))[0, 0] == 0
    flat = box(length=0.0)
    assert iou_bev(flat, box())[0, 0] == 0
    assert iou_bev(flat, flat)[0, 0] == 0
    assert iou_3d(box(height=0.0), box(height=0.0))[0, 0] == 0
    assert iou_bev(np.zeros((0, 7)), box()).shape == (0, 1)


def test_read_only_float32_and_rows():
    a = np.concatenate([box(), box(x=1.0), box(y=1.0)]).astype(np.float32)
    a.setflags(write=False)
    assert iou_3d(a, a).diagonal() == pytest.approx([1, 1, 1])
    assert paired_iou(a, a[::-1], three_d=False) == pytest.approx(
        iou_bev(a, a)[[0, 1, 2], [2, 1, 0]]
    )


def test_agrees_with_openpcdet():
    data = np.load(DATA)
    assert np.abs(iou_bev(data["a"], data["b"]) - data["iou_bev"]).max() < 5e-3
    assert np.abs(iou_3d(data["a"], data["b"]) - data["iou_3d"]).max() < 5e-3
    assert (data["iou_bev"] > 0.3).sum() > 50
