"""Sites beside the road: a log seen from poles, and simulated traffic at a junction."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from lidarplace import Lidar, Mount, OccupancyGrid, Placement, Roi
from lidarplace.clouds.collect import collect
from lidarplace.clouds.visibility import visibility
from lidarplace.logs.box_log import BoxLog, read_box_log, write_box_log
from lidarplace.logs.boxes import GEOMETRY, VIEWPOINT_Z
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.mounting.zone import Zone, distance, grid
from lidarplace.recall.counted_objects import CountedObjects
from lidarplace.scenes.kerbs import with_strips
from lidarplace.scenes.kinds import obstacles_around, scene_parts
from lidarplace.scenes.site import Site, near, seen_from
from lidarplace.scenes.sumo.settings import SumoScene
from tests.lidarplace.driven_past import POSES, driven_past
from tests.refused import refused

STANDING = Vehicle("nothing", np.empty((0, 2, 3)))
ROI = Roi((-24, 24), (-24, 24), (0, 4), 0.5)
POLES = Placement("poles", [Mount(12, 12, 6.0), Mount(-14, 12, 8.0)], Lidar.paper().thinned(0.1))
SCENE = SumoScene(
    seed=1, density=30, pedestrians=10, routes=2, test_routes=1, frames_per_route=3, warmup_s=5
)


def test_objects_of_a_log_keep_their_place_at_the_site():
    log = seen_from(driven_past(POSES), Site(x=30.0, y=0.0, yaw_deg=90.0))
    assert log.frames["frame"].tolist() == [1, 2]  # the first frame is 120 m away
    # The x axis of the site is the y axis of the world; its ground is that of the nearest frame.
    for name, expected in {"A": (10.0, 0.0, -1.75), "B": (-5.0, -10.0, -1.75)}.items():
        own = log.boxes[log.boxes["object_id"] == name]
        assert own[["x", "y", "z"]].to_numpy() == pytest.approx(np.tile(expected, (2, 1)))
    a = log.boxes.loc[log.boxes["object_id"] == "A", "yaw"]
    assert a.to_numpy() == pytest.approx(0.3 - math.pi / 2)
    recorder = log.boxes[log.boxes["object_id"].str.startswith("recorder")]
    assert recorder[["x", "y"]].to_numpy() == pytest.approx(np.array([[2, 5], [1, -20]]), abs=0.05)
    assert recorder["class"].unique() == ["Car"]
    assert recorder["length"].tolist() == [4.7, 4.7]
    assert (log.frames[["ego_x", "ego_y", "ego_z"]].to_numpy() == [30.0, 0.0, 2.5]).all()


def test_frames_count_by_the_distance_of_the_vehicle():
    log = driven_past(POSES)
    assert near(log.frames, Site(x=30.0, y=0.0, within=6.0)).tolist() == [False, True, False]
    assert near(log.frames, Site(x=30.0, y=0.0, scene="other")).sum() == 0
    unknown = log.frames.assign(ego_yaw=[0, math.nan, 0])
    assert near(unknown, Site(x=30.0, y=0.0)).tolist() == [False, False, True]


def test_a_vehicle_that_stands_still_is_the_site_to_the_bit():
    """Without a yaw, so that turns are exact; the recorder, an object of a site, is taken away."""
    log = driven_past([(20.0, 0.0, 0.0, 0.0, 0.0, 0.0)] * 3)
    site = seen_from(log, Site(x=20.0, y=0.0))
    boxes = site.boxes[~site.boxes["object_id"].str.startswith("recorder")]
    site = replace(site, boxes=boxes.reset_index(drop=True))
    pd.testing.assert_frame_equal(site.boxes, log.boxes, check_exact=True)
    assert_same(site, replace(log, frames=log.frames.assign(**{VIEWPOINT_Z: 15.0})))


def assert_same(site: BoxLog, still: BoxLog) -> None:
    """Compare clouds, POG and rays on objects of a site and of a vehicle without a body."""
    numbers = still.frames["frame"].to_numpy()
    assert (site.frames["frame"] == numbers).all()
    crop = (-24, -24, -0.5, 24, 24, 4)
    clouds = [collect(log, numbers, POLES, crop, vehicle=STANDING) for log in (site, still)]
    assert clouds[0].data.tobytes() == clouds[1].data.tobytes()
    assert len(clouds[0].data) > 1000
    one, other = (
        OccupancyGrid.from_boxes(log.boxes, ROI, object_class="Car", frames=len(numbers))
        for log in (site, still)
    )
    np.testing.assert_array_equal(one.probability, other.probability)
    (one,), (other,) = (
        CountedObjects.from_log(log, ROI, ["Car"], 0.1, vehicle=STANDING).seen_by([POLES])
        for log in (site, still)
    )
    assert one.points.sum() > 50
    assert one.points.tobytes() == other.points.tobytes()
    assert one.cells.tobytes() == other.cells.tobytes()


def test_simulated_traffic_at_a_junction_is_that_of_a_standing_vehicle(tmp_path):
    """The log of a site is that of a vehicle at one pose; a folder of it is one, too."""
    train, second, test = (part.recording.record() for part in scene_parts(SCENE, Site()))
    poses = pd.concat([train.frames, second.frames, test.frames])[["ego_x", "ego_y", "ego_yaw"]]
    assert len(poses.drop_duplicates()) == 1
    buildings = [log.buildings[list(GEOMETRY)] for log in (train, second, test)]
    assert all(each.equals(buildings[0]) for each in buildings)
    assert not train.boxes[list(GEOMETRY)].equals(second.boxes[list(GEOMETRY)])
    assert test.frames["split"].unique() == ["test"]
    write_box_log(tmp_path, train)
    assert_same(train, read_box_log(tmp_path))


def test_a_site_at_a_place_of_the_town_sees_what_is_there():
    """Two sites in one town see one object at one place of the world."""
    (one, _, _), (other, _, _) = (
        [part.recording.record() for part in scene_parts(SCENE, site)]
        for site in (Site(x=115.08, y=82.47), Site(x=125.08, y=72.47, yaw_deg=30.0))
    )
    worlds = []
    for log in (one, other):
        pose = log.frames.iloc[0]
        c, s = math.cos(pose["ego_yaw"]), math.sin(pose["ego_yaw"])
        x, y = log.boxes["x"], log.boxes["y"]
        world = log.boxes.assign(wx=pose["ego_x"] + c * x - s * y, wy=pose["ego_y"] + s * x + c * y)
        worlds.append(world.set_index(["frame", "object_id"])[["wx", "wy"]])
    both = worlds[0].join(worlds[1].add_suffix("_other"), how="inner")
    assert len(both) > 10
    assert both["wx"].to_numpy() == pytest.approx(both["wx_other"].to_numpy(), abs=1e-9)
    assert both["wy"].to_numpy() == pytest.approx(both["wy_other"].to_numpy(), abs=1e-9)


def test_a_car_behind_a_truck_counts_as_a_pole_may_see_it():
    rows = [("t", 6.0, 1.7, 8.0, 2.5, 3.4), ("c", 9.5, 0.7, 2.0, 1.8, 1.4)]
    boxes = pd.DataFrame(
        [
            ("s", 0, 0.0, name, "Car", x, 0.0, z, length / 4, width, height, 0.0)
            for name, x, z, length, width, height in rows
        ],
        columns=["scene", "frame", "timestamp_s", "object_id", "class", *GEOMETRY],
    )
    frames = pd.DataFrame(
        {"scene": "s", "frame": [0], "timestamp_s": 0.0, "route": 0, "split": "train"}
    )
    hidden = visibility(BoxLog(boxes, frames))
    assert hidden[1] == 0
    seen = visibility(BoxLog(boxes, frames.assign(**{VIEWPOINT_Z: 15.0})))
    assert seen[1] > 0.5


def test_a_pole_stands_in_no_wall_and_no_lane():
    around = obstacles_around(SCENE, Site())
    wall = around.buildings[0]
    for (x, y, z), problem in {
        (*wall[:2], 2.0): "inside of a building",
        (0.0, 0.0, 3.0): "in the way of vehicles",
    }.items():
        with refused(problem):
            around.check(Placement("p", [Mount(x, y, z)], POLES.lidars[0]))
    with refused(("p", "z", "16")):
        around.check(Placement("p", [Mount(30, 0, 16.0)], POLES.lidars[0]))
    around.check(Placement("p", [Mount(*wall[:2], wall[5] + 0.5), Mount(0, 0, 5)], POLES.lidars[0]))


def test_buildings_around_a_turned_site():
    """A wall of the town, in the frame of a site, is where the log of the site has it."""
    site = Site(yaw_deg=40.0)
    log = scene_parts(SCENE, site)[0].recording.record()
    pose, walls = log.frames.iloc[0], log.buildings
    dx, dy = walls["x"] - pose["ego_x"], walls["y"] - pose["ego_y"]
    c, s = math.cos(pose["ego_yaw"]), math.sin(pose["ego_yaw"])
    expected = np.stack([c * dx + s * dy, c * dy - s * dx], axis=1)
    places = obstacles_around(SCENE, site).buildings[:, :2]
    assert all(np.abs(places - place).sum(axis=1).min() < 1e-9 for place in expected)


@pytest.mark.parametrize("kerb", [(0.5, 2.5), (1.0, 1.0)])
def test_strips_follow_the_kerbs(kerb):
    """They are near lanes, on none and in no house, and leave no free part of a kerb out."""
    around = obstacles_around(SCENE, Site())
    along = {"kerb": kerb, "x": (-25, 25), "y": (-25, 25)}
    expanded = with_strips({"k": along}, SCENE, Site())
    zones = [Zone(name, zone["polygon"], (3.0, 5.0)) for name, zone in expanded.items()]
    assert 5 < len(zones) < 20
    for zone in zones:
        around.check_zone(zone)
        assert np.abs(zone.polygon).max() <= 25.0
        for x, y, _ in grid(zone, 0.6):
            assert away_from(around.lanes, x, y) <= kerb[1] + 1e-6
    middle = np.mean(kerb)
    for x in np.arange(-24, 24, 0.6):
        for y in np.arange(-24, 24, 0.6):
            near = min(distance(zone, x, y, 4.0) for zone in zones)
            on_kerb = abs(away_from(around.lanes, x, y) - middle) < 0.1
            if on_kerb and away_from(walls_of(around), x, y) > 2.0:
                assert near < 2.0


def away_from(rectangles, x, y) -> float:
    """Distance of a place from the nearest rectangle, metres; 0 inside."""
    dx, dy, turn = x - rectangles[:, 0], y - rectangles[:, 1], rectangles[:, 2]
    along = np.abs(np.cos(turn) * dx + np.sin(turn) * dy) - rectangles[:, 3]
    left = np.abs(np.cos(turn) * dy - np.sin(turn) * dx) - rectangles[:, 4]
    return float(np.hypot(np.maximum(along, 0), np.maximum(left, 0)).min())


def walls_of(around):
    return around.buildings[:, [0, 1, 6, 3, 4]] * [1, 1, 1, 0.5, 0.5]


@pytest.mark.parametrize(
    ("scene", "site", "expected"),
    [
        ({}, {"x": 9000.0, "y": 0.0}, ("", "site", "")),
        ({"towns": ("generated", "Town03")}, {}, ("", "scene.towns", "Town03, generated")),
        ({"min_travel_m": 1.0}, {}, ("", "scene.min_travel_m", "1")),
        ({}, {"within": 20.0}, "site.within: only a site in a log has it; remove it"),
    ],
)
def test_sites_that_cannot_be(scene, site, expected):
    with refused(expected):
        obstacles_around(SCENE.model_copy(update=scene), Site(**site))


def test_scenes_of_plug_ins_have_no_site():
    with refused(("", "source", "mine")):
        obstacles_around(SimpleNamespace(source="mine"), Site(x=1.0, y=2.0))


def test_logs_without_poses_have_no_site():
    log = driven_past(POSES)
    frames = log.frames.drop(columns="ego_yaw")
    with refused(("frames", "ego_yaw", "")):
        seen_from(replace(log, frames=frames), Site(x=0.0, y=0.0))
    with refused(("", "site.x", "")):
        seen_from(log, Site())
    with refused(("", "site", "")):
        seen_from(log, Site(x=500.0, y=0.0))
    with refused("x and y belong together"):
        Site(x=1.0)
