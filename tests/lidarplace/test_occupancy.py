import math

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace import OccupancyGrid, Roi
from lidarplace.logs.boxes import GEOMETRY

ROI = Roi(x=(-1.0, 3.0), y=(-2.0, 1.0), z=(0.0, 1.5), resolution=0.25)


def box_log(rows):
    """rows: (frame, class, x, y, z, length, width, height, yaw)."""
    return pd.DataFrame(rows, columns=["frame", "class", *GEOMETRY])


def brute_force(boxes, roi, object_class):
    """Voxel centres in boxes, with numpy over all voxels of every box."""
    x, y, z = np.meshgrid(*(roi.centres(axis) for axis in range(3)), indexing="ij")
    counts = np.zeros(roi.shape, int)
    for _, rows in boxes[boxes["class"] == object_class].groupby("frame"):
        inside = np.zeros(roi.shape, bool)
        for box in rows.itertuples():
            along = (x - box.x) * math.cos(box.yaw) + (y - box.y) * math.sin(box.yaw)
            across = (y - box.y) * math.cos(box.yaw) - (x - box.x) * math.sin(box.yaw)
            inside_box = (abs(along) <= box.length / 2) & (abs(across) <= box.width / 2)
            inside |= inside_box & (abs(z - box.z) <= box.height / 2)
        counts += inside
    return counts


CLASSES = ["Car", "Pedestrian"]
# Halves of voxels put faces exactly on centres.
coordinate = st.floats(-4, 4) | st.integers(-32, 32).map(lambda n: n / 8)
size = st.floats(0, 3) | st.integers(0, 24).map(lambda n: n / 8)
yaw = st.floats(-10, 10) | st.sampled_from([0.0, np.pi / 2, np.pi, np.pi / 4, 1e-17, 1e9])
numbers = [*[coordinate] * 3, *[size] * 3, yaw]
box_rows = st.tuples(st.integers(0, 3), st.sampled_from(CLASSES), *numbers)
boxes_strategy = st.lists(box_rows, max_size=10)


@given(boxes_strategy)
@settings(max_examples=80)
def test_counts_agree_with_brute_force(rows):
    boxes = box_log(rows)
    grids = OccupancyGrid.by_class(boxes, ROI, CLASSES, frames=4)
    assert list(grids) == CLASSES
    for name, grid in grids.items():
        np.testing.assert_array_equal(grid.counts, brute_force(boxes, ROI, name))
        alone = OccupancyGrid.from_boxes(boxes, ROI, name, frames=4)
        np.testing.assert_array_equal(grid.counts, alone.counts)
        assert (grid.roi, grid.object_class, grid.frames) == (ROI, name, 4)
        assert grid.counts.dtype == np.int32


@pytest.mark.parametrize(
    "roi",
    [
        Roi(x=(0.0, 1.0), y=(0.0, 1.0), z=(0.0, 40.0), resolution=0.25),
        Roi(x=(0.0, 1.0), y=(0.0, 40.0), z=(0.0, 1.0), resolution=0.25),
        Roi(x=(-7.3, 8.7), y=(1e6, 1e6 + 16), z=(-3.0, 13.0), resolution=1.0),
    ],
)
def test_counts_agree_with_brute_force_on_long_grids(roi):
    rng = np.random.default_rng(0)
    low, high = np.array([roi.x, roi.y, roi.z]).T
    for _ in range(20):
        n = 12
        boxes = pd.DataFrame({"frame": rng.integers(0, 3, n), "class": "Car"})
        boxes[["x", "y", "z"]] = rng.uniform(low - 1, high + 1, (n, 3))
        boxes[["length", "width", "height"]] = rng.exponential((high - low) / 3, (n, 3))
        boxes["yaw"] = rng.uniform(-4, 4, n)
        grid = OccupancyGrid.from_boxes(boxes, roi, "Car", frames=3)
        np.testing.assert_array_equal(grid.counts, brute_force(boxes, roi, "Car"))


@given(boxes_strategy, st.lists(st.integers(0, 2), min_size=4, max_size=4), st.randoms())
@settings(max_examples=20)
def test_grids_of_any_split_into_frames_merge_to_the_same(rows, part_of_frame, random):
    boxes = box_log(rows)
    whole = OccupancyGrid.from_boxes(boxes, ROI, "Car", frames=4)
    part = np.array(part_of_frame)
    parts = [
        OccupancyGrid.from_boxes(
            boxes[boxes["frame"].isin(np.flatnonzero(part == p))], ROI, "Car", int(sum(part == p))
        )
        for p in set(part_of_frame)
    ]
    for grid in parts:
        grid.counts.flags.writeable = False  # as Ray hands them out
    random.shuffle(parts)
    merged = OccupancyGrid.merged(iter(parts))
    np.testing.assert_array_equal(merged.counts, whole.counts)
    assert (merged.roi, merged.object_class, merged.frames) == (ROI, "Car", 4)
    assert merged.h_pog == whole.h_pog


def counts_of(*box, roi=ROI):
    return OccupancyGrid.from_boxes(box_log([(0, "Car", *box)]), roi, "Car", 1).counts


def test_huge_boxes():
    assert (counts_of(0.0, 0.0, 0.0, 1e3, 1e3, 1e3, 1e9) == 1).all()
    assert (counts_of(1e300, 0.0, 0.0, 3e300, 1e300, 1e300, 0.5) == 1).all()
    assert not counts_of(1e300, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0).any()
    assert not counts_of(-1.7e308, 1.7e308, 1e300, 1.7e308, 0.0, 1e300, 0.7).any()


def test_a_far_box_that_a_tiny_yaw_turns_into_the_roi():
    box = (1e300, 0.0, 0.5, 2e300, 1.0, 1.0, 1e-300)  # its side passes the origin at y = -1
    boxes = box_log([(0, "Car", *box)])
    expected = brute_force(boxes, ROI, "Car")
    assert 0 < expected.sum() < expected.size
    np.testing.assert_array_equal(counts_of(*box), expected)


def test_frames_of_two_scenes_with_the_same_numbers():
    box = ("Car", 1.0, 0.0, 0.5, 1.0, 1.0, 1.0, 0.0)
    boxes = box_log([(0, *box), (0, *box), (0, *box)]).assign(scene=["a", "b", "a"])
    assert OccupancyGrid.from_boxes(boxes, ROI, "Car", 2).counts.max() == 2


@pytest.mark.parametrize("dtype", [object, "category", "str", "string"])
def test_any_type_of_class_column(dtype):
    box = (1.0, 0.0, 0.5, 1.0, 1.0, 1.0, 0.0)
    boxes = box_log([(0, "Car", *box), (1, "Pedestrian", *box), (2, "Car", *box), (3, None, *box)])
    grids = OccupancyGrid.by_class(boxes.astype({"class": dtype}), ROI, CLASSES, 4)
    assert [grids[name].counts.max() for name in CLASSES] == [2, 1]
