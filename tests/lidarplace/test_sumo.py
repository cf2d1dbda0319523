"""Simulated traffic: the same bytes for a seed, plausible poses, no leak from train to test."""

import math
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from lidarplace.clouds.shapes import OWN_BODY
from lidarplace.logs.box_log import BoxLog, write_box_log
from lidarplace.logs.boxes import BOX_COLUMNS, BUILDING_COLUMNS, FRAME_COLUMNS, POSE_COLUMNS
from lidarplace.scenes.sumo.buildings import overlaps, rectangles_meet
from lidarplace.scenes.sumo.record import KEEP_M, boxes_around, drive, moved, record, town_parts
from lidarplace.scenes.sumo.settings import SumoScene
from lidarplace.scenes.sumo.traffic import (
    BOX_TRUCK,
    CAR,
    PEDESTRIAN,
    VEHICLES,
    RoadUser,
    cars_among,
)
from lidarplace.scenes.sumo.trajectories import Trajectories
from tests.refused import refused

pytest.importorskip("sumolib")

SHORT = {"frames_per_route": 10, "frame_stride": 5, "warmup_s": 5}
TINY = SumoScene(seed=3, density=60, pedestrians=20, routes=3, test_routes=2, **SHORT)


@pytest.fixture(scope="module")
def log() -> BoxLog:
    return record(TINY)


def test_same_bytes_again_in_another_process(log, tmp_path):
    write_box_log(tmp_path / "first", log)
    script = (
        "import sys; from pathlib import Path\n"
        "from lidarplace.logs.box_log import write_box_log\n"
        "from lidarplace.scenes.sumo.settings import SumoScene\n"
        "from lidarplace.scenes.sumo.record import record\n"
        "scene = SumoScene.model_validate_json(sys.argv[1])\n"
        "write_box_log(Path(sys.argv[2]), record(scene))\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", script, TINY.model_dump_json(), str(tmp_path / "second")],
        env={**os.environ, "PYTHONHASHSEED": "12345"},
        capture_output=True,
        check=True,
    )
    assert result.stdout == b""
    first, second = (
        {path.name: path.read_bytes() for path in (tmp_path / name).iterdir()}
        for name in ("first", "second")
    )
    assert len(first) == 3
    assert first == second


def test_schema(log):
    boxes, frames = log.boxes, log.frames
    assert tuple(boxes.columns) == BOX_COLUMNS
    assert tuple(frames.columns) == (*FRAME_COLUMNS, *POSE_COLUMNS)
    assert tuple(log.buildings.columns) == BUILDING_COLUMNS
    assert frames["frame"].tolist() == list(range(50))
    assert boxes["frame"].isin(frames["frame"]).all()
    assert boxes["frame"].is_monotonic_increasing
    names = {"sumo-3-train-generated", "sumo-3-test-generated"}
    assert set(boxes["scene"]) == set(frames["scene"]) == set(log.buildings["scene"]) == names
    assert not boxes.duplicated(["frame", "object_id"]).any()
    times = frames.set_index("frame")["timestamp_s"]
    np.testing.assert_array_equal(boxes["timestamp_s"], times.loc[boxes["frame"]])
    np.testing.assert_allclose(np.diff(times[:10]), 0.25)
    # Near, and on the ground.
    assert np.hypot(boxes["x"], boxes["y"]).max() <= KEEP_M
    np.testing.assert_array_equal(boxes["z"], boxes["height"] / 2)
    assert boxes["yaw"].between(-math.pi, math.pi, inclusive="right").all()


def test_train_and_test_share_no_route_and_no_object(log):
    boxes, frames = log.boxes, log.frames
    assert frames.groupby("route")["split"].nunique().eq(1).all()
    routes = frames.groupby("split")["route"].unique().map(list).to_dict()
    assert routes == {"train": [0, 1, 2], "test": [3, 4]}
    split = boxes["frame"].map(frames.set_index("frame")["split"])
    objects = boxes["object_id"].groupby(split).unique()
    assert not set(objects["train"]) & set(objects["test"])


def test_every_run_has_a_name_of_its_own():
    """Names tell world frames apart: poses and buildings of one name belong together."""
    towns = ("a/town.xodr", "b/town.xodr", "town-2.net.xml", "generated", "generated")
    scene = SumoScene(towns=towns, routes=3, egos_per_run=1, test_routes=2)
    names = [run.name for run in scene.town_runs()]
    assert len(names) == 5 * 3 + 5 * 2
    assert len(set(names)) == len(names)


def test_papers_split_calls_every_tenth_frame_test(log):
    paper = record(TINY.model_copy(update={"split": "paper"}))
    pd.testing.assert_frame_equal(paper.boxes, log.boxes)
    frames = paper.frames
    assert frames.loc[frames["split"] == "test", "frame"].tolist() == [9, 19, 29, 39, 49]


def test_classes_and_sizes(log):
    boxes = log.boxes
    kind = boxes["object_id"].str.extract(r"-([a-z]+)\d")[0]
    for k in (*VEHICLES, PEDESTRIAN):
        rows = boxes[kind == k.name]
        assert len(rows) > 0
        assert set(rows["class"]) == {k.object_class}
        for size in ("length", "width", "height"):
            assert rows[size].between(*getattr(k, size)).all()
            assert rows.groupby("object_id")[size].nunique().eq(1).all()
            assert rows[size].nunique() == rows["object_id"].nunique()
    truck = (BOX_TRUCK.length[0], BOX_TRUCK.width[0], BOX_TRUCK.height[0])
    assert (np.array(truck) > [5.2, 2.4, 2.6]).all()


def test_no_two_boxes_overlap_and_none_the_ego(log):
    boxes = log.boxes
    pairs = 0
    half = [1, 1, 1, 0.5, 0.5]
    ego = [0.0, 0.0, 0.0, *OWN_BODY[3:5]] * np.array(half)
    for _, frame in boxes.groupby("frame"):
        rectangles = frame[["x", "y", "yaw", "length", "width"]].to_numpy() * half
        a, b = np.triu_indices(len(frame), 1)
        less = rectangles - [0, 0, 0, 1e-9, 1e-9]
        assert not rectangles_meet(less[a], less[b]).any()
        assert not rectangles_meet(rectangles, np.tile(ego, (len(frame), 1))).any()
        pairs += len(a)
    assert pairs > 1000


@pytest.fixture(scope="module")
def traffic() -> Trajectories:
    changes = {"density": 100, "warmup_s": 30.0, "frame_stride": 4, "frames_per_route": 50}
    scene = TINY.model_copy(update=changes)
    return drive(scene, scene.town_runs()[0])[2]


def test_everybody_is_on_the_road_and_drives_where_he_looks(traffic):
    """Checks the turn from SUMO's compass angles: a displacement points along the yaw."""
    assert not np.isnan(traffic.pose).any()
    step = np.diff(traffic.pose[:, :, :2], axis=0)
    yaw = traffic.pose[:-1, :, 2]
    cars = [u for u, user in enumerate(traffic.users) if user.kind is CAR]
    straight = np.abs(np.diff(traffic.pose[:, :, 2], axis=0)) < 1e-3
    fast = (np.hypot(*step.transpose(2, 0, 1)) > 0.5) & straight
    along = step[:, :, 0] * np.cos(yaw) + step[:, :, 1] * np.sin(yaw)
    across = step[:, :, 1] * np.cos(yaw) - step[:, :, 0] * np.sin(yaw)
    assert fast[:, cars].sum() > 200
    assert (along[:, cars][fast[:, cars]] > 0.49).all()
    assert np.median(np.abs(across[:, cars][fast[:, cars]])) < 0.02


def test_a_queue_keeps_its_distance(traffic):
    """Checks the step from SUMO's front bumper to the box's centre: bumpers are apart."""
    gaps = []
    cars = [u for u, user in enumerate(traffic.users) if user.kind is CAR]
    for pose, speed in zip(traffic.pose, traffic.speed, strict=True):
        for follower in cars:
            x, y, yaw = pose[follower]
            dx, dy = pose[cars, 0] - x, pose[cars, 1] - y
            ahead = np.cos(yaw) * dx + np.sin(yaw) * dy
            aside = np.abs(np.cos(yaw) * dy - np.sin(yaw) * dx)
            for n in np.flatnonzero((ahead > 1) & (ahead < 9) & (aside < 0.3)):
                leader = cars[n]
                if abs(pose[leader, 2] - yaw) < 1e-3 and max(speed[[leader, follower]]) < 0.01:
                    lengths = traffic.users[leader].length + traffic.users[follower].length
                    gaps.append(ahead[n] - lengths / 2)
    assert len(gaps) > 30
    np.testing.assert_allclose(gaps, 2.5, atol=0.05)  # SUMO's minimum gap


def synthetic(*pose: tuple[float, float, float]) -> Trajectories:
    """One recorded step; cars 4 x 2 x 1.5 m."""
    users = [RoadUser(f"car{u}", CAR, 4.0, 2.0, 1.5) for u in range(len(pose))]
    poses, level = np.array([pose], np.float64), np.zeros((1, len(pose)))
    return Trajectories(users, np.zeros(1), poses, level, level + 1)


RUN = SumoScene().town_runs()[0]
FIRST = np.zeros(1, np.int64)
NO_PAIRS = np.empty((0, 3), np.int64)


def test_ego_frame():
    north = math.pi / 2
    traffic = synthetic((10, 20, north), (10, 25, north), (7, 20, math.pi), (12, 20, 0))
    boxes = boxes_around(traffic, NO_PAIRS, 0, FIRST, RUN, 40)
    np.testing.assert_allclose(boxes[["x", "y"]], [[5, 0], [0, 3], [0, -2]], atol=1e-12)
    np.testing.assert_allclose(boxes["yaw"], [0, math.pi / 2, -math.pi / 2])
    assert boxes["frame"].tolist() == [40] * 3
    assert boxes["object_id"].tolist() == [f"{RUN.name}-car{u}" for u in (1, 2, 3)]
    # Yaw stays in its interval.
    traffic = synthetic((0, 0, 0.0), (9, 0, math.pi), (18, 0, -math.pi), (27, 0, 3 * math.pi))
    boxes = boxes_around(traffic, NO_PAIRS, 0, FIRST, RUN, 0)
    np.testing.assert_array_equal(boxes["yaw"], math.pi)


def test_only_near_ones_on_the_road_and_one_of_an_overlapping_pair():
    traffic = synthetic((0, 0, 0), (60, 0, 0), (60.1, 0, 0), (np.nan,) * 3, (10, 0, 0), (11, 0, 0))
    pairs = np.array([[0, 4, 5]])
    boxes = boxes_around(traffic, pairs, 0, FIRST, RUN, 0)
    assert boxes["object_id"].tolist() == [f"{RUN.name}-car1", f"{RUN.name}-car4"]
    boxes = boxes_around(traffic, pairs, 5, FIRST, RUN, 0)
    assert f"{RUN.name}-car4" not in boxes["object_id"].tolist()


def test_another_level_is_neither_seen_nor_hit():
    traffic = synthetic((0, 0, 0), (1, 0, 0), (10, 0, 0), (11, 0, 0))
    bridge = replace(traffic, z=np.array([[0.0, 6.0, 0.5, 6.0]]))
    np.testing.assert_array_equal(overlaps(traffic), [[0, 0, 1], [0, 2, 3]])
    assert len(overlaps(bridge)) == 0
    under_bridge = boxes_around(bridge, overlaps(bridge), 0, FIRST, RUN, 0)
    on_bridge = boxes_around(bridge, overlaps(bridge), 1, FIRST, RUN, 0)
    assert under_bridge["object_id"].tolist() == [f"{RUN.name}-car2"]
    assert on_bridge["object_id"].tolist() == [f"{RUN.name}-car3"]
    np.testing.assert_array_equal(on_bridge["z"], 0.75)


def test_frames_are_kept_after_the_ego_moved():
    x = np.array([0, 0.4, 0.9, 1.0, 1.9, 2.5, 2.6, 3.5])
    steps = moved(np.stack([x, np.zeros(8)], axis=1), 1.0)
    assert steps.tolist() == [0, 3, 5, 7]
    assert moved(np.zeros((3, 2)), 0.0).tolist() == [0, 1, 2]


def test_min_travel_thins_the_log_and_keeps_the_numbers_of_routes(log):
    near = record(TINY.model_copy(update={"min_travel_m": 2.0}))
    frames = near.frames
    assert 5 < len(frames) < len(log.frames)
    assert frames["frame"].is_unique
    for route, part in frames.groupby("route"):
        same_frames = log.frames[log.frames["route"] == route]
        same_frames = same_frames[same_frames["timestamp_s"].isin(part["timestamp_s"])]
        assert part["frame"].tolist() == list(range(10 * route, 10 * route + len(part)))
        np.testing.assert_array_equal(part[[*POSE_COLUMNS]], same_frames[[*POSE_COLUMNS]])
        steps = np.hypot(*np.diff(part[["ego_x", "ego_y"]], axis=0).T)
        assert (steps >= 2.0).all()
        same = log.boxes["frame"].isin(same_frames["frame"])
        part_boxes = near.boxes[near.boxes["frame"].isin(part["frame"])]
        np.testing.assert_array_equal(part_boxes["x"], log.boxes.loc[same, "x"])


def test_the_pose_places_a_box_where_its_object_is():
    """The same object seen by two egos of a town is in one place of the town's frame."""
    log = record(TINY.model_copy(update={"routes": 8, "test_routes": 0}))
    merged = log.boxes.merge(log.frames, on=["scene", "frame", "timestamp_s"])
    cos, sin = np.cos(merged["ego_yaw"]), np.sin(merged["ego_yaw"])
    merged["world_x"] = merged["ego_x"] + cos * merged["x"] - sin * merged["y"]
    merged["world_y"] = merged["ego_y"] + sin * merged["x"] + cos * merged["y"]
    seen = merged.groupby(["scene", "timestamp_s", "object_id"])[["world_x", "world_y"]]
    spread = seen.max() - seen.min()
    assert (seen.size() > 1).sum() > 20
    assert spread.to_numpy().max() < 1e-9


def test_rectangles_meet():
    across, aslant = (0, math.pi / 2), (2.1, math.pi / 4)
    others = [(4.1, 0, 0), (3.9, 0, 0), (3.1, *across), (0, 2.9, across[1]), (3.1, *aslant)]
    others.append((3.1, 2.1, -math.pi / 4))
    first = np.tile([0, 0, 0, 2.0, 1.0], (6, 1))
    second = np.array([(*place, 2.0, 1.0) for place in others])
    for pair in ((first, second), (second, first)):
        assert rectangles_meet(*pair).tolist() == [False, True, False, True, True, False]


def test_more_vehicles_than_fit():
    runs = SumoScene(density=10, routes=8, egos_per_run=4).town_runs()
    assert [run.routes for run in runs] == [4, 4, 4]
    assert cars_among(1) == 1
    assert cars_among(80) == 56
    scene = TINY.model_copy(update={"density": 2000, "frames_per_route": 1, "warmup_s": 0.0})
    with refused(("", "density", "")):
        record(scene)


def test_without_sumo_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "libsumo", None)
    with pytest.raises(ImportError, match=r"pip install 'lidarplace\[sumo\]'"):
        record(TINY)


def test_another_seed_for_tests_changes_no_training_route():
    usual, other = (SumoScene(seed=3, test_seed=s).town_runs() for s in (None, 7))
    assert usual[0] == other[0]
    assert usual[0].traffic_seed != SumoScene(seed=4).town_runs()[0].traffic_seed
    assert usual[1].part == other[1].part == "test"
    for name in ("name", "town_seed", "traffic_seed"):
        assert getattr(usual[1], name) != getattr(other[1], name)
    on_map = [SumoScene(seed=3, test_seed=s, towns=("Town03",)).town_runs() for s in (None, 7)]
    assert {run.town_seed for runs in on_map for run in runs} == {on_map[0][0].town_seed}
    assert on_map[0][1].traffic_seed != on_map[1][1].traffic_seed
    parts = [town_parts(SumoScene(seed=3, test_seed=s)) for s in (None, 7)]
    assert parts[0][0] == parts[1][0]  # so that trainings stay as they are
