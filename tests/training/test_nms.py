"""Suppression of overlapping boxes: OpenPCDet, the definition, both paths."""

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.refused import refused
from training.ops import grouping
from training.ops.nms import _unsuppressed_torch, nms
from training.ops.rotated_iou import iou_bev, unsuppressed

DATA = np.load(Path(__file__).parents[1] / "data" / "training_ops.npz")


def box(x=0.0, y=0.0, length=4.0, width=2.0, yaw=0.0):
    return [x, y, 0.0, length, width, 1.5, yaw]


@pytest.mark.usefixtures("last_bits")
@pytest.mark.parametrize(
    ("threshold", "pre", "expected"),
    [
        (0.01, 4096, "keep_001"),
        (0.1, 4096, "keep_01"),
        (0.7, 4096, "keep_07"),
        (0.1, 100, "keep_01_pre100"),
    ],
)
def test_keeps_what_openpcdet_keeps(threshold, pre, expected):
    boxes, scores = torch.from_numpy(DATA["boxes"]), torch.from_numpy(DATA["scores"])
    expected = DATA[expected].tolist()
    assert nms(boxes, scores, threshold, pre=pre).tolist() == expected
    assert nms(boxes, scores, threshold, pre=pre, post=20).tolist() == expected[:20]
    best = scores.argsort(descending=True, stable=True)[:pre]
    rows = _unsuppressed_torch(boxes[best], threshold)
    assert best[rows].tolist() == expected


def test_by_hand():
    three = torch.tensor([box(), box(x=2.0), box(x=4.0)])  # neighbours have IoU 1/3

    def kept(scores, threshold, **limits):
        return nms(three, torch.tensor(scores), threshold, **limits).tolist()

    assert kept([0.9, 0.5, 0.7], 0.4) == [0, 2, 1]
    assert kept([0.9, 0.5, 0.7], 0.4, post=0) == []
    assert kept([0.9, 0.5, 0.7], 0.4, pre=2) == [0, 2]
    assert kept([0.5, 0.5, 0.5], 0.3) == [0, 2]
    assert nms(three[:0], torch.zeros(0), 0.3).tolist() == []
    assert _unsuppressed_torch(three[:0], 0.3).tolist() == []


def by_definition(boxes, threshold):
    """The keep-list from all pairs, in float64."""
    overlap = iou_bev(boxes, boxes)
    survivors = []
    for i in range(len(boxes)):
        survivors += [i] * (not (overlap[survivors, i] > threshold).any())
    return survivors


def assert_kept(boxes, threshold):
    boxes = np.asarray(boxes, np.float64)
    expected = by_definition(boxes, threshold)
    assert unsuppressed(boxes, threshold, len(boxes)).tolist() == expected
    assert _unsuppressed_torch(torch.from_numpy(boxes), threshold).tolist() == expected


@pytest.mark.usefixtures("last_bits")
@settings(max_examples=40)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(1, 80),
    st.floats(0, 0.95),
    st.sampled_from([0.0, 0.3, 3.0, 30.0, 1e4]),
    st.sampled_from([0.01, 1.0]),
)
def test_all_pairs_decide(seed, count, threshold, spread, alike):
    # From one heap to boxes that never meet, of like and of very different sizes and angles.
    random = np.random.default_rng(seed)
    crowd = np.column_stack(
        [random.normal(0, 1, (count, 3)) * spread,
         3 * np.exp(random.normal(0, 1, (count, 3)) * alike), random.normal(0, 3, count) * alike]
    )  # fmt: skip
    assert_kept(crowd, threshold)


@pytest.mark.usefixtures("last_bits")
@settings(max_examples=40)
@given(
    st.lists(
        st.tuples(st.integers(-4, 4), st.integers(-4, 4), st.integers(0, 3), st.integers(0, 3),
                  st.integers(0, 3)),
        min_size=1, max_size=40,
    ),
    st.sampled_from([0.0, 0.25, 1 / 3, 0.5, 1.0]),
)  # fmt: skip
def test_overlaps_of_exactly_the_threshold(rows, threshold):
    # Touching, coinciding and flat boxes; IoU of whole numbers.
    crowd = np.array([box(x, y, length, width, 0.5 * math.pi * yaw)
                      for x, y, length, width, yaw in rows])  # fmt: skip
    # Away from the threshold by more than rounding, on either side.
    for near in (threshold + 1e-6, max(0, threshold - 1e-6)):
        assert_kept(crowd, near)


def test_dense_proposals_on_both_paths(monkeypatch):
    random = np.random.default_rng(5)
    centre = np.array([box(10 * k, yaw=k) for k in range(8)])
    crowd = centre[random.integers(0, 8, 300)] + random.normal(0, 0.1, (300, 7))
    expected = by_definition(crowd, 0.8)
    assert 30 < len(expected) < 280
    assert unsuppressed(crowd, 0.8, 300).tolist() == expected
    assert unsuppressed(crowd, 0.8, 20).tolist() == expected[:20]
    monkeypatch.setattr(grouping, "CHUNK", 10_000)
    assert _unsuppressed_torch(torch.from_numpy(crowd), 0.8).tolist() == expected


def test_only_boxes_that_take_part_are_looked_at():
    boxes = torch.tensor([box(), box(x=math.nan)], requires_grad=True)
    scores = torch.tensor([0.9, 0.1], dtype=torch.bfloat16)
    assert nms(boxes, scores, 0.5, pre=1).tolist() == [0]
    with refused(("", "boxes", "NaN or infinity")):
        nms(boxes, scores, 0.5)
    with refused(("", "boxes", "NaN or infinity")):
        _unsuppressed_torch(boxes, 0.5)
