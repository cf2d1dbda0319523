"""A whole collection from the server in `carla_world`: boxes, clouds, resuming, cleaning up."""

from unittest.mock import call

import numpy as np
import pandas as pd
import pytest

from tests.refused import refused

pytest.importorskip("carla")
from lidarplace.clouds.clouds import PointClouds, read_clouds
from lidarplace.logs.box_log import read_box_log
from lidarplace.plugins.carla.collect import collect, unhit
from lidarplace.plugins.carla.settings import CarlaScene
from lidarplace.plugins.carla.traffic import Traffic
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement
from tests.lidarplace.carla_world import MODELS, SLOPE_DEG, Server

LIDAR = Lidar(tuple(np.radians(np.linspace(-25, 5, 8))), azimuth_steps=240, range=60.0)
MOUNTS = [Mount(0.3, 0.7, 2.2, -0.28, 0.05, 0.4), Mount(-0.4, -0.6, 1.9, 0.2, -0.09, -2.0)]
TILTED = Placement("tilted", MOUNTS, LIDAR)
CENTER = Placement("center", [Mount(z=2.4)], LIDAR)
SCENE = CarlaScene(
    towns=("Town01",), density=8, pedestrians=4, routes=1, test_routes=1, frames_per_route=3,
    frame_stride=4, warmup_s=0.2, timeout_s=1.0,
)  # fmt: skip


def run(out, server=None, scene=SCENE, placements=(TILTED, CENTER), **kwargs):
    server = server or Server()
    rigs = {placement.name: placement for placement in placements}
    return server, collect(scene, rigs, out, connected=lambda scene: server, **kwargs)


@pytest.fixture(scope="module")
def collected(tmp_path_factory):
    out = tmp_path_factory.mktemp("carla")
    server, log = run(out)
    return out, server, log


def clouds_of(out, placement, routes=("route-000", "route-001")):
    for route in routes:
        clouds = read_clouds(out / "clouds" / placement / route)
        yield from ((int(f), clouds[i], clouds.counts[i]) for i, f in enumerate(clouds.frames))


def off_surface(points, boxes):
    """Distance of every point from the surface of every box, shape (points, boxes)."""
    columns = []
    for box in boxes.itertuples():
        c, s = np.cos(box.yaw), np.sin(box.yaw)
        x, y, z = (points[:, :3] - [box.x, box.y, box.z]).T
        half = np.array([box.length, box.width, box.height]) / 2
        out = np.abs(np.stack([c * x + s * y, c * y - s * x, z], axis=1)) - half
        away = np.linalg.norm(out.clip(0), axis=1)
        columns.append(np.where((out <= 0).all(axis=1), -out.max(axis=1), away))
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("name", ["tilted", "center"])
def test_every_point_lies_on_the_ground_or_on_a_box(collected, name):
    out, _, log = collected
    on_boxes = 0
    for frame, points, counts in clouds_of(out, name):
        assert counts.min() > 100
        boxes = log.boxes[log.boxes["frame"] == frame]
        away = off_surface(points, boxes)
        ground = np.abs(points[:, 2]) < 0.003
        # Pedestrians stand upright, so in the frame of the leaning ego they lean, boxes do not.
        upright = (boxes["class"] == "Pedestrian").to_numpy()
        slack = np.where(upright, 0.93 * np.sin(np.radians(SLOPE_DEG)), 0.0) + 0.003
        hit = (away < slack) & ~ground[:, None]
        assert (hit.any(axis=1) | ground).all()
        on_boxes += (hit.sum(axis=0) > 3).sum()
        # Whatever stands in the open within 8 m is hit.
        near = np.hypot(boxes["x"], boxes["y"]).to_numpy() < 8
        assert hit[:, near].any(axis=0).all()
    assert on_boxes > 12


def test_own_body_is_left_out_and_the_crop_kept(collected):
    out, *_ = collected
    half = np.array(MODELS[SCENE.ego][:3])
    for _, points, _ in clouds_of(out, "tilted"):
        in_body = (np.abs(points[:, :3] - [0, 0, half[2]]) <= half + 0.05).all(axis=1)
        assert not in_body.any()
        low, high = np.array(SCENE.crop[:3]), np.array(SCENE.crop[3:])
        assert ((points[:, :3] >= low - 0.001) & (points[:, :3] <= high + 0.001)).all()


def test_boxes_are_in_the_ego_frame(collected):
    out, _, log = collected
    assert read_box_log(out).boxes.equals(log.boxes)
    assert read_box_log(out).frames.equals(log.frames)
    cars = log.boxes[log.boxes["class"] != "Pedestrian"]
    # Road and vehicles rise together, so in the leaning frame all stand level on z = 0.
    np.testing.assert_allclose(cars["z"], cars["height"] / 2, atol=1e-3)
    np.testing.assert_allclose(np.abs(np.sin(cars["yaw"])), 0, atol=1e-3)
    assert log.boxes.groupby(["frame", "object_id"]).size().max() == 1
    assert set(log.boxes["class"]) == {"Car", "Cyclist", "Pedestrian"}
    frames = log.frames
    assert frames["frame"].tolist() == [0, 1, 2, 3, 4, 5]
    assert frames["split"].tolist() == ["train"] * 3 + ["test"] * 3
    np.testing.assert_allclose(frames["timestamp_s"], [0, 0.2, 0.4] * 2)


def test_the_ego_moves_ahead_in_the_right_handed_world(collected):
    _, _, log = collected
    for _, frames in log.frames.groupby("route"):
        step = np.diff(frames[["ego_x", "ego_y"]].to_numpy(), axis=0)
        ahead = np.array([np.cos(frames["ego_yaw"]), np.sin(frames["ego_yaw"])]).T[:-1]
        along = 8.0 * 4 * 0.05 * np.cos(np.radians(SLOPE_DEG))
        np.testing.assert_allclose((step * ahead).sum(axis=1), along, rtol=1e-2)


def test_world_is_left_as_it_was_found(collected):
    _, server, _ = collected
    assert len(server.worlds) == 2 + 2 * 2  # a drive a route, a replay a route and placement
    for world in server.worlds:
        assert not world.actors
        assert not world.settings.synchronous_mode
        assert world.hidden == {7}
    manager = server.traffic_manager
    assert manager.set_synchronous_mode.call_args == call(False)
    assert len({seed_call.args for seed_call in manager.set_random_device_seed.call_args_list}) == 2
    assert server.most_sensors == len(TILTED.mounts)  # one placement at a time


def test_nothing_is_done_twice_and_placements_can_be_added(tmp_path):
    first, log = run(tmp_path, placements=[CENTER])
    assert first.ticks > 0
    for gone in ((), ("boxes", "frames", "buildings")):  # they are made from the routes
        for name in gone:
            (tmp_path / f"{name}.parquet").unlink()
        again, repeated = run(tmp_path, placements=[CENTER])
        assert again.ticks == 0
        pd.testing.assert_frame_equal(repeated.boxes, log.boxes)
    assert (tmp_path / "frames.parquet").exists()
    more, _ = run(tmp_path, placements=[TILTED])
    assert [world.town for world in more.worlds] == ["Town01"] * 2
    assert not more.traffic_manager.mock_calls  # nothing was driven anew


@pytest.mark.parametrize("dies_at", [3, 25, 50])
def test_a_stopped_collection_goes_on_with_the_next_route(tmp_path, dies_at, collected):
    out, whole, log = collected
    broken = Server(dies_at=dies_at)
    with pytest.raises(RuntimeError, match="waiting for the simulator"):
        run(tmp_path, broken)
    assert all(not world.actors for world in broken.worlds)
    assert not broken.worlds[-1].settings.synchronous_mode
    rest, resumed = run(tmp_path)
    assert rest.ticks < whole.ticks or dies_at == 3
    assert resumed.boxes.equals(log.boxes)
    both = zip(clouds_of(out, "tilted"), clouds_of(tmp_path, "tilted"), strict=True)
    for (_, a, _), (_, b, _) in both:
        np.testing.assert_array_equal(a, b)


def test_another_scene_or_placement_needs_another_place(tmp_path):
    run(tmp_path, placements=[CENTER])
    with refused(("scene.json", "density", "9"), "expected 8 "):
        run(tmp_path, scene=SCENE.model_copy(update={"density": 9}))
    other = Placement("center", [Mount(z=2.5)], LIDAR)
    with refused(("placement.json", "mounts", "2.5")):
        run(tmp_path, placements=[other])
    # Where the server is does not matter.
    run(tmp_path, scene=SCENE.model_copy(update={"host": "elsewhere"}), placements=[CENTER])


def test_nothing_is_written_before_there_is_a_server(tmp_path):
    def nobody(scene):
        raise ConnectionError("no server")

    with pytest.raises(ConnectionError):
        collect(SCENE, {"center": CENTER}, tmp_path, connected=nobody)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("wrong", "changes", "error", "message"),
    [  # 12 road users, then LiDAR 1 and LiDAR 2
        ({"mute": 14}, {"timeout_s": 0.05}, TimeoutError, "tilted: LiDAR 2 delivered nothing"),
        ({"shove": 0.5}, {}, RuntimeError, r"frame \d: vehicle\S+ stands 0\.50 m from where"),
        ({"glass": "*"}, {"frames_per_route": 8, "density": 12}, RuntimeError, "look through them"),
    ],
)
def test_a_server_that_goes_wrong_is_an_error(tmp_path, wrong, changes, error, message):
    server = Server(**wrong)
    with pytest.raises(error, match=message):
        run(tmp_path, server, SCENE.model_copy(update=changes), [TILTED])
    assert not server.worlds[-1].actors


def test_who_vanishes_is_in_no_later_frame_or_cloud(tmp_path):
    # 1 step for the walkers' controllers, 4 of warm-up, and 4 a frame: gone before frame 1.
    lines = []
    _, log = run(tmp_path, Server(vanish=(10, 3)), placements=[CENTER], report=lines.append)
    boxes = log.boxes[log.boxes["object_id"] == "0-2"]
    assert boxes["frame"].tolist() == [0]
    poses = Traffic.read(tmp_path / "routes/route-000").poses
    assert poses.groupby("frame").size().tolist() == [12, 11, 11]
    assert any(line == "route-000 Town01: 3 clouds of center" for line in lines)


def test_models_without_a_box_are_left_out_and_named(tmp_path):
    lines = []
    models = MODELS | {"vehicle.bh.crossbike": (0.75, 0.0, 0.8, 0.0)}
    scene = SCENE.model_copy(update={"density": 16})
    run(tmp_path, Server(models=models), scene, placements=[], report=lines.append)
    assert any("left out: vehicle.bh.crossbike" in line for line in lines)
    actors = Traffic.read(tmp_path / "routes/route-000").actors
    assert len(actors) == 16 + SCENE.pedestrians
    assert "vehicle.bh.crossbike" not in set(actors["blueprint"])


def test_frames_are_left_out_until_the_ego_has_moved(tmp_path):
    # 8 m/s and 4 steps: 1.6 m a frame along the slope.
    changes = {"frames_per_route": 23, "min_travel_m": 3.0, "density": 2, "split": "paper"}
    _, log = run(tmp_path, scene=SCENE.model_copy(update=changes), placements=[])
    assert log.frames["frame"].tolist() == [*range(0, 23, 2), *range(23, 46, 2)]
    # Every tenth frame that is kept, of each route.
    assert log.frames.loc[log.frames["split"] == "test", "frame"].tolist() == [18, 41]


@pytest.mark.parametrize(
    ("key", "value", "error", "expected"),
    [
        ("density", 25, ("Town01", "density", "25"), "at most 24"),
        ("towns", ("Town06",), ("CARLA server", "map", "Town06"), "Town01, Town03"),
        ("ego", "vehicle.none", ("", "ego", "vehicle.none"), ""),
        ("routes", 25, ("Town01", "", "24"), "25 starts"),
    ],
)
def test_what_the_town_lacks(tmp_path, key, value, error, expected):
    server = Server()
    with refused(error, expected):
        run(tmp_path, server, SCENE.model_copy(update={key: value}), placements=[])
    assert all(not world.actors for world in server.worlds)


def test_models_that_lidars_look_through_are_named():
    row = {"y": 0.0, "z": 0.75, "length": 4.0, "width": 2.0, "height": 1.5, "yaw": 0.1}
    at = [{"frame": frame, "x": x} for frame in range(20) for x in (6.0, 12.0, 30.0)]
    boxes = pd.DataFrame([place | row for place in at])
    models = pd.Series(["solid", "glass", "far"] * 20)
    # A return from the solid one, in one frame; all others are of the road.
    clouds = [
        (np.array([[4.0, 0, 0.8 * (frame == 7), 1], [12, 0, 0, 1]], np.float32), [2])
        for frame in range(20)
    ]
    clouds = PointClouds.from_frames(range(20), clouds, SCENE.crop)
    assert unhit(boxes, models, clouds) == (["glass"], False)
    only = models != "solid"
    assert unhit(boxes[only], models[only], clouds) == (["glass"], True)
    assert unhit(boxes[only].iloc[2:], models[only].iloc[2:], clouds) == ([], False)
