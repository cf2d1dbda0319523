"""Shapes of objects: within their boxes, tight, and the same wherever the object appears."""

import math

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace.clouds.reflectivity import uniforms
from lidarplace.clouds.shapes import (
    BODY,
    MARGIN_M,
    OWN_BODY,
    PANE,
    TRUCK_LENGTH,
    Parts,
    own_body,
    shapes_of,
)
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount
from lidarplace.rigs.pose import rotation
from tests.lidarplace.from_a_car import cast
from tests.lidarplace.test_raycast import faces
from tests.refused import refused

NAMES = ("Car", "Cyclist", "Pedestrian", "Tram")


def table(names: list[str], geometry: np.ndarray) -> pd.DataFrame:
    boxes = pd.DataFrame(geometry, columns=list(GEOMETRY))
    return boxes.assign(object_id=[f"object{i}" for i in range(len(boxes))], **{"class": names})


def parts_of(boxes: pd.DataFrame, seed: int = 0) -> Parts:
    geometry = boxes[list(GEOMETRY)].to_numpy(np.float64)
    return shapes_of(boxes, seed).parts(np.arange(len(boxes)), geometry)


def corners_in_box(parts: Parts, box: np.ndarray) -> np.ndarray:
    """Corners of all parts in the frame of the box, as shares of its half size."""
    found = np.concatenate([faces(part)[0] for part in parts.geometry])
    return (found - box[:3]) @ rotation(0, 0, box[6]) / (box[3:6] / 2)


def of_row(parts: Parts) -> np.ndarray:
    """The object of each part, windows with it."""
    return np.where(parts.owner <= PANE, PANE - parts.owner, parts.owner)


@given(
    name=st.sampled_from(NAMES),
    size=st.tuples(*[st.floats(0.3, 12)] * 3),
    yaw=st.floats(-math.pi, math.pi),
    seed=st.integers(0, 10**6),
)
@settings(max_examples=60, derandomize=True)
def test_parts_never_leave_their_box_and_come_close_to_its_faces(name, size, yaw, seed):
    box = np.array([3.0, -2.0, 1.0, *size, yaw])
    parts = parts_of(table([name], box[None]), seed)
    assert 1 <= len(parts) <= 8
    corners = corners_in_box(parts, box)
    assert (np.abs(corners) <= 1 + 1e-12).all()
    np.testing.assert_allclose(corners[:, 2].min(), -1, atol=1e-12)
    vehicle = name == "Car" or (name == "Cyclist" and size[0] > TRUCK_LENGTH)
    if vehicle:
        margin = np.minimum(np.array(MARGIN_M), 0.2 * np.array(size)) / np.array(size)
        np.testing.assert_allclose(corners.max(axis=0), 1 - margin * 2, atol=1e-12)
        np.testing.assert_allclose(corners[:, :2].min(axis=0), 2 * margin[:2] - 1, atol=1e-12)
    if name == "Tram":
        np.testing.assert_allclose(corners.max(axis=0), 1, atol=1e-12)
    # Tops are no wider than nothing.
    insets = parts.geometry[:, 7:9].sum(axis=1), 2 * parts.geometry[:, 9]
    assert (insets[0] <= parts.geometry[:, 3] + 1e-12).all()
    assert (insets[1] <= parts.geometry[:, 4] + 1e-12).all()
    assert (parts.geometry[:, 3:][:, [0, 1, 2, 4, 5, 6]] >= 0).all()
    np.testing.assert_array_equal(parts.reflectivity > 0, parts.owner == 0)
    np.testing.assert_array_equal(parts.owner[parts.owner != 0], [PANE] * (name == "Car"))


def test_windows_hide_what_is_behind_them_and_return_nothing():
    places = [[10, 0, 0.75, 4.5, 1.8, 1.5, 1.57], [13, 0, 0.9, 0.6, 0.6, 1.8, 0]]
    parts = parts_of(table(["Car", "Pedestrian"], np.array(places, float)))
    solid = parts.owner >= 0
    bare = Parts(parts.geometry[solid], parts.owner[solid], parts.reflectivity[solid])
    lidar = Lidar(tuple(np.radians(np.linspace(-10, 5, 200))), azimuth_steps=3600)
    met, open_ = (cast(Mount(z=1.4), lidar, own) for own in (parts, bare))
    assert (met.target == PANE).sum() > 100
    assert (met.target == 1).sum() < (open_.target == 1).sum()


def test_parts_of_an_object_hang_together():
    """Each part overlaps or touches another one of its object in height."""
    sizes = {"Car": (4.5, 1.8, 1.5), "Cyclist": (1.8, 0.6, 1.7), "Pedestrian": (0.5, 0.6, 1.8)}
    rows = [(0, 0, 0, *sizes[name], 0) for name in sizes] + [(0, 0, 0, 7.0, 2.5, 3.0, 0)]
    boxes = table([*sizes, "Cyclist"], np.array(rows, np.float64))
    for seed in range(20):
        parts = parts_of(boxes, seed)
        for owner in range(4):
            own = parts.geometry[(parts.owner == owner) | (parts.owner == PANE - owner)]
            bottom, top = own[:, 2] - own[:, 5] / 2, own[:, 2] + own[:, 5] / 2
            order = np.argsort(bottom)
            covered = np.maximum.accumulate(top[order])
            assert (bottom[order][1:] <= covered[:-1] + 1e-12).all()


def test_a_cyclist_is_a_truck_or_a_rider_by_its_length():
    geometry = np.array([[0, 0, 0, length, 2, 2, 0] for length in (1.7, 2.1, 4.0, 4.1)], float)
    parts = parts_of(table(["Cyclist"] * 4, geometry))
    numbers = np.bincount(parts.owner)  # none has windows
    np.testing.assert_array_equal(numbers, [8, 8, 8, 8])
    assert (parts.geometry[parts.owner == 3, 5] > 1.3).any()  # the box, of most of the height


def test_cars_come_in_variants():
    number = 300
    cars = table(["Car"] * number, np.tile([0, 0, 0.75, 4.5, 1.8, 1.5, 0], (number, 1)))
    parts = parts_of(cars)
    cabins = parts.geometry[parts.owner <= PANE]
    assert len(np.unique(cabins[:, 3])) > 200  # no two alike
    rear = (cabins[:, 0] - cabins[:, 3] / 2) / (4.5 - 2 * MARGIN_M[0]) + 0.5
    share = np.histogram(rear, bins=[0, 0.06, 0.2, 0.6])[0] / number  # to the tail, boot, bed
    np.testing.assert_allclose(share, [0.53, 0.40, 0.07], atol=4 * math.sqrt(0.25 / number))


def test_an_object_looks_the_same_in_every_frame_and_portion():
    geometry = np.tile([5.0, 1.0, 0.75, 4.5, 1.8, 1.5, 0.3], (6, 1))
    boxes = table(["Car"] * 6, geometry).assign(object_id=["a", "b", "a", "c", "b", "a"])
    whole, alone = parts_of(boxes), parts_of(boxes[3:4])
    cars = [whole.geometry[of_row(whole) == row] for row in range(6)]
    paints = [whole.reflectivity[of_row(whole) == row] for row in range(6)]
    for row in (2, 5):
        np.testing.assert_array_equal(cars[0], cars[row])
        np.testing.assert_array_equal(paints[0], paints[row])
    np.testing.assert_array_equal(alone.geometry, cars[3])
    np.testing.assert_array_equal(alone.reflectivity, paints[3])
    drawn = np.concatenate([paints[0], paints[1], paints[3]])
    assert len(set(drawn[drawn > 0])) == 21  # each part its own
    assert not np.array_equal(parts_of(boxes, seed=1).geometry, whole.geometry)
    assert not np.array_equal(cars[0], cars[1])


def test_draws_are_the_same_in_every_process():
    """Python's own hash would change from one process to the next."""
    assert uniforms("3/car00001", 5)[:2].tolist() == [0.1681770955735663, 0.577345325182625]
    assert uniforms("3/car00001", 5, b"other")[0] != uniforms("3/car00001", 5)[0]
    geometry = np.tile([5.0, 1.0, 0.75, 4.5, 1.8, 1.5, 0.3], (2, 1))
    boxes = table(["Car"] * 2, geometry)
    numbers, text = (parts_of(boxes.assign(object_id=ids)) for ids in ([17, 3], ["17", "3"]))
    np.testing.assert_array_equal(numbers.geometry, text.geometry)
    np.testing.assert_array_equal(numbers.reflectivity, text.reflectivity)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("size", [(0.0, 0.0, 0.0), (0.0, 2.0, 1.0), (1e6, 1e6, 1e6)])
def test_zero_size_and_huge_boxes(name, size):
    box = np.array([10.0, 0.0, 0.0, *size, 0.5])
    parts = parts_of(table([name], box[None]))
    assert np.isfinite(parts.geometry).all()
    far = np.abs(parts.geometry[:, :3] - box[:3]).max(axis=0)
    assert (far <= np.linalg.norm(size) / 2).all()


def test_no_objects_and_no_ids():
    none = table([], np.empty((0, 7)))
    assert len(parts_of(none)) == 0
    with refused(("box log", "object_id", "")):
        shapes_of(table(["Car"], np.ones((1, 7))).drop(columns="object_id"))


def test_own_body_fills_its_box():
    body = own_body()
    assert (body.owner == BODY).all()
    corners = corners_in_box(body, np.array(OWN_BODY))
    np.testing.assert_allclose([corners.min(axis=0), corners.max(axis=0)], [[-1] * 3, [1] * 3])


@pytest.mark.parametrize(("name", "size"), [("Car", (4.5, 1.8, 1.5)), ("Cyclist", (7.0, 2.5, 3.0))])
def test_plates_and_lamps_are_seen_at_the_ends_and_not_from_the_side(name, size):
    lidar = Lidar(tuple(np.radians(np.linspace(-20, 5, 200))), azimuth_steps=3600)
    found = {}
    for yaw in (0.0, math.pi / 2, math.pi):
        box = np.array([[12.0, 0.0, size[2] / 2, *size, yaw]])
        parts = parts_of(table([name], box))
        lights = parts.geometry[:, 5] < 0.1 * size[2]  # they alone are so flat
        lit = Parts(parts.geometry, lights.astype(np.int32), lights * 1.0)
        hits = cast(Mount(z=1.8), lidar, lit)
        met = hits.target >= 0
        found[yaw] = (hits.target[met] == 1).mean()
    assert found[0.0] > 0.01
    assert found[math.pi] > 0.01
    if name == "Car":
        assert found[math.pi / 2] == 0
