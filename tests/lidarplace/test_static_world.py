"""The static world: rays against brute force, and worlds rebuilt from simulated clouds."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from lidarplace import Lidar, Mount, Placement, Roi
from lidarplace.base.kernel_cache import njit
from lidarplace.clouds.collect import collect
from lidarplace.clouds.raycast import GROUND, NOTHING, cast
from lidarplace.clouds.shapes import BUILDING, WORLD, bricks
from lidarplace.clouds.static_world import cast_in_world, stop_in_world, stops
from lidarplace.clouds.surroundings import Surroundings
from lidarplace.clouds.visibility import visible_share
from lidarplace.clouds.worlds import WorldAround, worlds_of
from lidarplace.logs.box_log import BoxLog, join_logs, read_box_log, write_box_log
from lidarplace.logs.boxes import BOX_COLUMNS, BUILDING_COLUMNS
from lidarplace.logs.world import (
    CELL_M,
    PATCH_M,
    PATCHES,
    TILE_M,
    StaticWorld,
    cell_keys,
    cells_of_keys,
)
from lidarplace.recall.counted_objects import CountedObjects
from lidarplace.rigs.pose import rotation
from lidarplace.rigs.recorded import RecordedRig
from lidarplace.scenes.static_world.world_builder import static_worlds
from tests.refused import refused

NO_PARTS = bricks(np.empty((0, 7)), 0)
CAR = bricks(np.array([[9.0, 2, 1, 2, 2, 2, 0.3]]), 0)
AROUND = (-60.0, -60.0, -12.0, 60.0, 60.0, 15.0)
MOUNTS = [Mount(0.3, 0.0, 1.9), Mount(-0.3, 0.0, 1.7, roll=np.pi)]
LIDAR = replace(Lidar.named("vlp32c"), azimuth_steps=900)
RIG = RecordedRig(("up", "down"), Placement("recorded", MOUNTS, lidar=LIDAR))


@njit()
def _stops(share, key, ray):
    return stops(share, key, ray)


def heights_of(ground, tiles):
    """Of a function of x and y, at the corners of patches."""
    along = np.arange(PATCHES + 1) * PATCH_M
    x, y = np.meshgrid(along, along, indexing="ij")
    return np.array([ground(i * TILE_M + x, j * TILE_M + y) for i, j in tiles], np.float32)


def rising(x, y):
    return 1.5 * np.sin(x / 25.0) + 0.04 * y


TILES = np.array([(i, j) for i in range(-4, 5) for j in range(-4, 5)], np.int32)


def world_of(cells, rng, tiles=TILES[:0], ground=rising):
    keys = np.unique(cell_keys(np.asarray(cells, np.int64).reshape(-1, 3)))
    ends = np.sort(rng.integers(0, 256, (len(keys), 2, 3)), axis=1).reshape(-1, 6)
    share = np.where(rng.random(len(keys)) < 0.5, 255, rng.integers(1, 255, len(keys)))
    cells = np.c_[ends, share, rng.integers(1, 256, len(keys))].astype(np.uint8)
    heights = heights_of(ground, tiles).reshape(-1, PATCHES + 1, PATCHES + 1)
    return StaticWorld(np.array([100.0, -20.0, 3.0]), keys, cells, tiles, heights)


@pytest.mark.parametrize("seed", range(2))
def test_rays_meet_what_testing_each_against_every_cell_finds(seed):
    rng = np.random.default_rng(seed)
    cells = rng.integers((-60, -60, -8), (60, 60, 25), (1500, 3))
    steps = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)])
    world = world_of(np.concatenate([cells + step for step in steps]), rng)
    mount = Mount(*rng.uniform(-1, 1, 2), 2.2, *rng.uniform(-0.4, 0.4, 2), rng.uniform(-3, 3))
    lidar = Lidar(tuple(np.radians(np.linspace(-30, 20, 16))), azimuth_steps=90, range=30.0)
    turn, shift = rotation(0.03, -0.05, rng.uniform(-3, 3)), rng.uniform(-3, 3, 3)
    around = WorldAround(worlds_of({"a": world}), 0, turn, shift)
    hits = cast_in_world(mount, lidar, CAR, around)

    boxes = world.boxes() - np.tile(world.origin, 2)
    own = cast(mount, lidar, CAR)  # flat ground
    ways, start = lidar.directions() @ mount.rotation.T @ turn.T, turn @ mount.position + shift
    met, targets = own.range.copy(), own.target.copy()
    for ray, way in enumerate(ways):
        a, b = (boxes[:, :3] - start) / way, (boxes[:, 3:] - start) / way
        near, far = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
        for n in np.flatnonzero((near > 0) & (near <= far) & (near < met[ray]) & (near <= 30)):
            if near[n] < met[ray] and _stops(world.cells[n, 6], world.keys[n], ray):
                met[ray], targets[ray] = near[n], WORLD
    assert (targets == WORLD).sum() > 50
    np.testing.assert_array_equal(hits.target, targets)
    np.testing.assert_allclose(hits.range, met, rtol=1e-9)
    few = cast(mount, lidar, CAR, level=False)
    stop_in_world(mount, lidar, few, around, only_objects=True)
    np.testing.assert_array_equal(few.target >= 0, ours := targets >= 0)
    np.testing.assert_allclose(few.range[ours], met[ours], rtol=1e-9)


def test_an_object_is_seen_where_neither_a_box_nor_the_world_hides_it():
    """The share is that of a scene whose cells and ground are boxes, too; shares multiplied are
    not: the same rays may be hidden twice."""
    rng = np.random.default_rng(3)
    cells = rng.integers((20, -40, -4), (60, 40, 12), (600, 3))
    yaw, shift = 0.4, np.array([0.5, -0.7, 0.3])
    before_box = rotation(0, 0, yaw) @ [7.0, 0.8, 0.4] + shift  # they hide the same
    hiding = (before_box / CELL_M).astype(int) + np.argwhere(np.ones((3,) * 3))
    cells = np.concatenate([cells, hiding])
    flat = np.array([(i, j) for i in range(-2, 3) for j in range(-2, 3)], np.int32)
    world = world_of(cells, rng, flat, lambda x, y: 0.0 * x - 0.8)
    whole = world.cells.copy()
    whole[:, 6] = 255
    world = replace(world, cells=whole, origin=np.zeros(3))
    places = [(14.0, 1, 0, 4, 2, 1.5, 0.3), (12, -6, 0, 4, 2, 1.5, 1), (9, 1, 0.2, 1, 1, 2, 0)]
    objects = np.array(places)
    boxes = world.boxes()
    ground = np.array([[-60.0, -60, -2.3, 60, 60, -0.8]])
    low, high = np.split(np.concatenate([boxes, ground]) - np.tile(shift, 2), 2, axis=1)
    middle = (low + high) / 2 @ rotation(0, 0, yaw)
    walls = bricks(np.c_[middle, high - low, np.full(len(low), -yaw)], BUILDING)
    cars, eye = bricks(objects, np.arange(3)), (0.0, 0.0, 1.0)
    around = WorldAround(worlds_of({"a": world}), 0, rotation(0, 0, yaw), shift)
    seen = visible_share(eye, cars, 3, (40, 30), around)
    np.testing.assert_allclose(seen, visible_share(eye, cars.and_(walls), 3, (40, 30)), atol=3e-3)
    alone = visible_share(eye, cars, 3, (40, 30))
    each = (bricks(own[None], 0) for own in objects)
    past_world = np.array([visible_share(eye, own, 1, (40, 30), around)[0] for own in each])
    assert 0.1 < alone[0] < 0.9
    assert ((past_world > 0.1) & (past_world < 0.98)).all()
    assert abs(seen[0] - alone[0] * past_world[0]) > 0.01


def test_rays_come_down_to_uneven_ground():
    world = world_of(np.empty((0, 3)), np.random.default_rng(0), TILES)
    lidar = Lidar(tuple(np.radians(np.linspace(-25, 3, 12))), azimuth_steps=240, range=70.0)
    mount = Mount(0.2, 0.1, 2.0, roll=0.05, pitch=-0.02)
    shift = np.array([3.0, 4.0, float(rising(3.0, 4.0))])
    around = WorldAround(worlds_of({"a": world}), 0, np.eye(3), shift)
    hits = cast_in_world(mount, lidar, NO_PARTS, around)
    ways, start = lidar.directions() @ mount.rotation.T, mount.position + shift
    t = np.linspace(0.05, 70.0, 7000)
    for ray in range(0, lidar.rays, 7):
        x, y, z = (start + t[:, None] * ways[ray]).T
        under = np.flatnonzero(z < rising(x, y))
        if len(under):
            assert hits.target[ray] == GROUND
            x, y, z = start + hits.range[ray] * ways[ray]
            assert z == pytest.approx(rising(x, y), abs=0.06)  # patches are bilinear
            assert hits.range[ray] <= t[under[0]] + 5.0
        elif not np.isfinite(hits.range[ray]):
            assert hits.target[ray] == NOTHING


def drive(ground=None):
    """A street: two walls, a pole, cars that move, and one parked that has a box in no frame."""
    frames, speed = 40, 1.0
    walls = [(20, 9, 3, 70, 1, 6, 0.0), (20, -9, 3, 70, 1, 6, 0.02)]
    parked = (22.0, 4.5, 0.75, 4.5, 1.8, 1.5, 0.0)
    still = [*walls, parked, (12.0, -5.0, 2.0, 0.3, 0.3, 4.0, 0.3)]
    x = speed * np.arange(frames)
    boxes = [
        ("a", n, n / 10, "mover", "Car", 5 + 0.7 * n - x[n], 2.0, 0.75, 4.5, 1.8, 1.5, 0.0)
        for n in range(frames)
    ]
    table = pd.DataFrame({"scene": "a", "frame": np.arange(frames), "timestamp_s": 0.1, "route": 0})
    table = table.assign(split="train", ego_x=x, ego_y=0.0, ego_yaw=0.0)
    buildings = pd.DataFrame([("a", *row) for row in still], columns=list(BUILDING_COLUMNS))
    log = BoxLog(pd.DataFrame(boxes, columns=list(BOX_COLUMNS)), table, rigs={"a": RIG})
    return replace(log, buildings=buildings), log


@pytest.fixture(scope="module")
def rebuilt():
    """The log with its walls as buildings, and with the world that its clouds show."""
    simulated, bare = drive()
    frames = simulated.frames["frame"].to_numpy()
    clouds = collect(simulated, frames, RIG.placement, AROUND)
    return simulated, replace(bare, world=static_worlds(bare, [clouds]))


def test_a_world_of_clouds_stops_rays_where_its_buildings_did(rebuilt):
    simulated, bare = rebuilt
    old, new = Surroundings(simulated), Surroundings(bare)
    mount, lidar = Mount(0.0, 0.4, 2.0), Lidar.named("vlp16")  # none of those that recorded it
    shares = []
    for frame in (10, 20, 30):
        was = cast(mount, lidar, old.parts(frame, 100.0))
        now = cast_in_world(mount, lidar, new.parts(frame, 100.0), new.world(frame))
        wall = (was.target == BUILDING) & (was.range < 25)
        error = now.range[wall] - was.range[wall]
        shares.append((np.mean(np.abs(error) < CELL_M), np.mean(error < -2 * CELL_M)))
        floor = (was.target == GROUND) & (was.range < 25)
        low = np.abs(now.range[floor] - was.range[floor]) < CELL_M
        assert low.mean() > 0.95
    right, short = np.mean(shares, axis=0)
    assert right > 0.9
    assert short < 0.01


def test_what_moves_leaves_nothing_and_what_is_parked_stays(rebuilt):
    _, bare = rebuilt
    boxes = bare.world["a"].boxes()
    middle = 0.5 * (boxes[:, :3] + boxes[:, 3:])
    lane = (np.abs(middle[:, 1] - 2.0) < 1.2) & (middle[:, 0] > 0) & (middle[:, 0] < 50)
    assert not lane.any()
    parked = (np.abs(middle[:, 0] - 22) < 2.4) & (np.abs(middle[:, 1] - 4.5) < 1.1)
    assert parked.sum() > 50
    assert middle[parked, 2].max() < 1.6


def test_the_world_hides_objects_in_clouds_and_in_recall_alike(rebuilt):
    simulated, bare = rebuilt
    roi = Roi((-40, 40), (-20, 20), (0, 4), resolution=0.5)
    behind = [("a", 20, 2.0, "hidden", "Car", 2.0, 12.0, 0.75, 4.5, 1.8, 1.5, 0.0)]
    behind += [("a", 20, 2.0, "seen", "Car", 8.0, -2.0, 0.75, 4.5, 1.8, 1.5, 0.0)]
    boxes = pd.DataFrame(behind, columns=list(simulated.boxes.columns))
    with_car = replace(bare, boxes=boxes)
    found = CountedObjects.from_log(with_car, roi, ["Car"], 0.3)
    assert found.table["object_id"].tolist() == ["seen"]
    open_ = CountedObjects.from_log(replace(with_car, world={}), roi, ["Car"], 0.3)
    assert open_.table["object_id"].tolist() == ["hidden", "seen"]
    points = collect(with_car, [20], RIG.placement, AROUND)[0]
    assert (np.abs(points[:, :2] - [2.0, 12.0]) < 1.0).all(axis=1).mean() < 1e-3


def test_uneven_ground_is_rebuilt_from_clouds():
    _, bare = drive()
    rng = np.random.default_rng(0)
    world = world_of(np.empty((0, 3)), rng, TILES, lambda x, y: rising(x, 0 * y))
    world = replace(world, origin=np.zeros(3))
    x = bare.frames["ego_x"].to_numpy()
    slope = np.arctan(1.5 / 25 * np.cos(x / 25))
    frames = bare.frames.assign(ego_z=rising(x, 0.0), ego_roll=0.0, ego_pitch=-slope)
    hilly = replace(bare, frames=frames, world={"a": world}, boxes=bare.boxes.iloc[:0])
    clouds = collect(hilly, frames["frame"].to_numpy(), RIG.placement, AROUND)
    again = static_worlds(replace(hilly, world={}), [clouds])["a"]
    assert len(again.keys) < 20  # all of it is ground
    along = np.arange(PATCHES + 1) * PATCH_M
    errors = []
    for (i, j), heights in zip(again.tiles, again.heights, strict=True):
        px, py = np.meshgrid(i * TILE_M + along, j * TILE_M + along, indexing="ij")
        px, py = px + again.origin[0], py + again.origin[1]
        near = (px > 0) & (px < 40) & (np.abs(py) < 12)
        errors.append((heights + again.origin[2] - rising(px, 0.0))[near])
    error = np.concatenate(errors)
    assert len(error) > 50
    assert np.abs(error).max() < 0.12


def test_worlds_are_kept_in_a_log(rebuilt, tmp_path):
    _, bare = rebuilt
    write_box_log(tmp_path, bare)
    again = read_box_log(tmp_path)
    for name, array in vars(bare.world["a"]).items():
        np.testing.assert_array_equal(getattr(again.world["a"], name), array)
    assert "static world of 1 scenes" in repr(again)
    (tmp_path / "world.npz").write_bytes(b"PK no")
    with refused((str(tmp_path / "world.npz"), "", "")):
        read_box_log(tmp_path)
    write_box_log(tmp_path, replace(bare, world={}))
    assert not read_box_log(tmp_path).world
    other = replace(bare, frames=bare.frames.assign(frame=bare.frames["frame"] + 100))
    moved = replace(other, boxes=bare.boxes.assign(frame=bare.boxes["frame"] + 100))
    assert join_logs([bare, moved]).world["a"] is bare.world["a"]


def test_keys_name_cells():
    rng = np.random.default_rng(1)
    cells = rng.integers(-4000, 4000, (1000, 3))
    np.testing.assert_array_equal(cells_of_keys(cell_keys(cells)), cells)
