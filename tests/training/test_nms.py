"""Suppression of overlapping boxes: OpenPCDet, the definition, both paths."""

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.refused import refused
from training.ops import nms as suppression
from training.ops.gpu import rotated_iou as kernels
from training.ops.rotated_iou import iou_bev, unsuppressed

DATA = np.load(Path(__file__).parents[1] / "data" / "training_ops.npz")


def box(x=0.0, y=0.0, length=4.0, width=2.0, yaw=0.0):
    return [x, y, 0.0, length, width, 1.5, yaw]


@pytest.fixture(scope="module", autouse=True)
def few_programs():
    """Large tiles: each program takes milliseconds on a CPU."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kernels, "_ROWS", 256)
        yield


def on_both(frames, scores, threshold, **limits):
    """Rows that survive in each frame, by either kernel; the last boxes of a frame are padding."""
    fill, count = -torch.inf, max(map(len, scores))
    boxes = torch.full((len(frames), count, 7), torch.nan, dtype=frames[0].dtype)
    ranks = torch.full((len(frames), count), fill, dtype=scores[0].dtype)
    for frame, (rows, values) in enumerate(zip(frames, scores, strict=True)):
        boxes[frame, : len(rows)], ranks[frame, : len(rows)] = rows, values
    results = []
    for select in (suppression._unsuppressed_numba, suppression._unsuppressed_triton):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(suppression, "_unsuppressed_numba", select)
            rows, counts = suppression.nms(boxes, ranks, threshold, **limits)
        pairs = zip(rows.tolist(), counts.tolist(), strict=True)
        results.append([survivors[:many] for survivors, many in pairs])
    assert results[0] == results[1]
    return results[0]


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
    frames = [boxes, boxes[:0]], [scores, scores[:0]]
    assert on_both(*frames, threshold, pre=pre) == [expected, []]
    assert on_both(*frames, threshold, pre=pre, post=20) == [expected[:20], []]


def test_by_hand():
    three = torch.tensor([box(), box(x=2.0), box(x=4.0)])  # neighbours have IoU 1/3

    def kept(scores, threshold, **limits):
        return on_both([three], [torch.tensor(scores)], threshold, **limits)[0]

    assert kept([0.9, 0.5, 0.7], 0.4) == [0, 2, 1]
    assert kept([0.9, 0.5, 0.7], 0.4, post=0) == []
    assert kept([0.9, 0.5, 0.7], 0.4, pre=2) == [0, 2]
    assert kept([0.5, 0.5, 0.5], 0.3) == [0, 2]
    assert kept([-math.inf, 0.9, 0.7], 0.3) == [1]
    assert on_both([three[:0]], [torch.zeros(0)], 0.3) == [[]]


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
    ranks = -torch.arange(len(boxes)).double()
    assert on_both([torch.from_numpy(boxes)], [ranks], threshold) == [expected]


@pytest.mark.usefixtures("last_bits")
@settings(max_examples=25)
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
@settings(max_examples=25)
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


def test_dense_proposals_on_both_paths():
    random = np.random.default_rng(5)
    centre = np.array([box(10 * k, yaw=k) for k in range(8)])
    crowd = centre[random.integers(0, 8, 300)] + random.normal(0, 0.1, (300, 7))
    expected = by_definition(crowd, 0.8)
    assert 30 < len(expected) < 280
    assert unsuppressed(crowd, 0.8, 300).tolist() == expected
    assert unsuppressed(crowd, 0.8, 20).tolist() == expected[:20]
    frames, ranks = torch.from_numpy(crowd), -torch.arange(300).double()
    expected = [by_definition(crowd[:300], 0.8), by_definition(crowd[:130], 0.8)]
    frames, ranks = ([part, part[:130]] for part in (frames, ranks))
    assert on_both(frames, ranks, 0.8) == expected
    assert on_both(frames, ranks, 0.8, post=20) == [rows[:20] for rows in expected]


def test_only_boxes_that_take_part_are_looked_at():
    boxes = torch.tensor([[box(), box(x=math.nan)]], requires_grad=True)
    scores = torch.tensor([[0.9, 0.1]], dtype=torch.bfloat16)
    rows, counts = suppression.nms(boxes, scores, 0.5, pre=1)
    assert (rows.tolist(), counts.tolist()) == ([[0]], [1])
    with refused(("", "boxes", "NaN or infinity")):
        suppression.nms(boxes, scores, 0.5)
