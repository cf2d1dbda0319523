import math

import mpmath
import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace import OccupancyGrid, Roi
from lidarplace.boxes import GEOMETRY
from lidarplace.occupancy import binary_entropy

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
            inside |= (
                (abs(along) <= box.length / 2)
                & (abs(across) <= box.width / 2)
                & (abs(z - box.z) <= box.height / 2)
            )
        counts += inside
    return counts


coordinate = st.floats(-4, 4)
size = st.floats(0, 3)
boxes_strategy = st.lists(
    st.tuples(
        st.integers(0, 3),
        st.sampled_from(["Car", "Pedestrian"]),
        coordinate,
        coordinate,
        coordinate,
        size,
        size,
        size,
        st.floats(-10, 10),
    ),
    max_size=8,
)


@given(boxes_strategy)
@settings(max_examples=60, deadline=None)
def test_counts_agree_with_brute_force(rows):
    boxes = box_log(rows)
    grid = OccupancyGrid.from_boxes(boxes, ROI, "Car", frames=4)
    np.testing.assert_array_equal(grid.counts, brute_force(boxes, ROI, "Car"))


def test_a_frame_counts_once_however_many_boxes_overlap():
    box = ("Car", 1.0, 0.0, 0.5, 1.0, 1.0, 1.0, 0.0)
    grid = OccupancyGrid.from_boxes(box_log([(0, *box), (0, *box), (1, *box)]), ROI, "Car", 5)
    assert grid.counts.max() == 2
    assert grid.probability.max() == 2 / 5


def test_extreme_boxes():
    huge = (0, "Car", 0.0, 0.0, 0.0, 1e3, 1e3, 1e3, 1e9)
    assert (OccupancyGrid.from_boxes(box_log([huge]), ROI, "Car", 1).counts == 1).all()
    far = (0, "Car", 1e300, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0)
    point_off_centre = (0, "Car", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for row in (far, point_off_centre):
        assert not OccupancyGrid.from_boxes(box_log([row]), ROI, "Car", 1).counts.any()
    point_on_centre = (0, "Car", 0.125, 0.125, 0.125, 0.0, 0.0, 0.0, 0.0)
    assert OccupancyGrid.from_boxes(box_log([point_on_centre]), ROI, "Car", 1).counts.sum() == 1


def test_a_class_that_never_occurs():
    grid = OccupancyGrid.from_boxes(box_log([]), ROI, "Cyclist", frames=10)
    assert grid.entropy_sum() == 0.0
    assert not grid.entropy.any()


def test_more_frames_than_T():
    box = ("Car", 1.0, 0.0, 0.5, 1.0, 1.0, 1.0, 0.0)
    with pytest.raises(ValueError, match="2 frames, more than frames=1"):
        OccupancyGrid.from_boxes(box_log([(0, *box), (1, *box)]), ROI, "Car", 1)


@pytest.mark.parametrize("frames", [1, 2, 3, 400, 10**7])
def test_entropy_against_mpmath(frames):
    counts = np.unique(np.clip([0, 1, 2, frames // 2, frames - 2, frames - 1, frames], 0, frames))
    with mpmath.workdps(50):
        for count, found in zip(counts.tolist(), binary_entropy(counts, frames), strict=True):
            p = mpmath.mpf(count) / frames
            expected = 0 if p in (0, 1) else -p * mpmath.log(p) - (1 - p) * mpmath.log(1 - p)
            assert found == pytest.approx(float(expected), rel=1e-14)


def test_entropy_sum_is_exact_in_any_order():
    rng = np.random.default_rng(0)
    counts = rng.integers(0, 1000, ROI.shape).astype(np.int32)
    grid = OccupancyGrid(ROI, "Car", counts, 1000)
    shuffled = OccupancyGrid(ROI, "Car", rng.permuted(counts), 1000)
    assert grid.entropy_sum() == pytest.approx(math.fsum(grid.entropy.ravel()), rel=1e-14)
    assert grid.entropy_sum() == shuffled.entropy_sum()
    half = np.zeros(ROI.shape, bool)
    half[::2] = True
    assert grid.entropy_sum(half) == pytest.approx(math.fsum(grid.entropy[half]), rel=1e-14)
    assert grid.entropy_sum(np.zeros(ROI.shape, bool)) == 0.0
