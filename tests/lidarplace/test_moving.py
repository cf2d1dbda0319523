"""Rays of a scan that takes time, compared with closed forms and with a finely stepped world."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from pydantic import ValidationError

from lidarplace import Lidar, Mount, Placement
from lidarplace.base.errors import InputError
from lidarplace.clouds.collect import collect
from lidarplace.clouds.moving import Motion, Scan, cast_moving, poses_at
from lidarplace.clouds.raycast import cast
from lidarplace.clouds.shapes import BODY, bricks
from lidarplace.configuration.sensor import SensorSettings
from lidarplace.configuration.settings import fault
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.motion import motion_in
from lidarplace.rigs.scan_pattern import ScanPattern
from lidarplace.rigs.scan_timing import ScanTiming
from sweeps.stages.task import plain

CROP = (-60.0, -60.0, -0.5, 60.0, 60.0, 6.0)


def solid_state(rays: int = 2000) -> Lidar:
    """Rays to random places ahead, in a random order."""
    rng = np.random.default_rng(0)
    azimuths, elevations = rng.uniform(-0.6, 0.6, rays), rng.uniform(-0.05, 0.05, rays)
    return Lidar.patterned(ScanPattern(azimuths, elevations, rays))


def angles(lidar: Lidar) -> tuple[np.ndarray, np.ndarray]:
    """Azimuth and elevation of every ray."""
    x, y, z = lidar.directions().T
    return np.arctan2(y, x), np.arcsin(z)


@pytest.mark.parametrize("lidar", [Lidar.even(8, (-3, 3), 3600), solid_state()])
@pytest.mark.parametrize("timing", [ScanTiming(10.0), ScanTiming(5.0, 2.0, "right")])
def test_smear_of_a_wall_is_that_of_the_closed_form(lidar, timing):
    """A wall 40 m ahead that comes at 30 m/s and goes left at 20: azimuth by azimuth."""
    wall = bricks(np.array([[40.0, 3.0, 2.0, 1e-9, 8.0, 40.0, 0.0]]), 0)
    motion = Motion(np.zeros(3), np.array([[40.0, 3.0, -30.0, 20.0, 0.0]]))
    moments = timing.moments(lidar.scan_shares(), timing.phase)
    hits = cast_moving(Mount(), lidar, wall, motion, Scan.at(moments))
    t = np.broadcast_to(moments, (lidar.beams, lidar.fired_steps)).ravel()
    azimuth, elevation = angles(lidar)
    away = 40.0 - 30.0 * t
    aside = away * np.tan(azimuth) - (3.0 + 20.0 * t)
    expected = (np.cos(azimuth) > 0) & (np.abs(aside) <= 4.0)
    assert 0 < expected.sum() < lidar.rays
    assert np.array_equal(hits.target == 0, expected)
    ranges = (away / np.cos(azimuth) / np.cos(elevation))[expected]
    assert np.abs(hits.range[expected] - ranges).max() < 1e-9
    cosine = (np.cos(azimuth) * np.cos(elevation))[expected]
    assert np.abs(hits.reflected[expected] - cosine).max() < 1e-9


OBJECTS = pd.DataFrame(
    [  # x, y, z, length, width, height, yaw; velocity and yaw rate in the world
        (12.0, 3.0, 0.9, 4.5, 1.8, 1.6, 0.2, -30.0, 2.0, 0.0),
        (4.0, -2.5, 0.8, 4.0, 1.8, 1.5, 0.0, 25.0, 0.0, 0.0),
        (-15.0, 0.5, 0.9, 4.5, 1.8, 1.6, 3.0, 5.0, 20.0, 0.6),
        (-8.0, -9.0, 0.9, 0.6, 0.6, 1.8, 1.0, 0.5, 1.5, -1.0),
        (20.0, 25.0, 4.0, 40.0, 10.0, 8.0, 0.1, 0.0, 0.0, 0.0),
        (0.5, 6.0, 1.5, 9.0, 2.5, 3.0, 0.0, -30.0, 0.0, 0.3),
    ],
    columns=["x", "y", "z", "length", "width", "height", "yaw", "vx", "vy", "spin"],
)
EGO = np.array([20.0, 1.0, 0.4])


def boxes_at(t: float, ego: np.ndarray = EGO) -> np.ndarray:
    """The objects in the frame of the vehicle at a moment, rows of `GEOMETRY`."""
    boxes = OBJECTS.to_numpy()
    x, y = (boxes[:, n] + (boxes[:, 7 + n] - ego[n]) * t for n in range(2))
    c, s, yaw = np.cos(ego[2] * t), np.sin(ego[2] * t), boxes[:, 6] + (boxes[:, 9] - ego[2]) * t
    return np.column_stack([c * x + s * y, c * y - s * x, boxes[:, 2:6], yaw])


def moving_parts():
    """The objects and a body at the moment 0, and their motion."""
    parts = bricks(boxes_at(0.0), np.arange(len(OBJECTS), dtype=np.int32))
    body = bricks(np.array([[-1.0, 0.0, 0.8, 3.0, 1.8, 1.6, 0.0]]), BODY)
    rates = OBJECTS[["x", "y", "vx", "vy", "spin"]].to_numpy()
    return parts.and_(body), Motion(EGO, np.concatenate([rates, np.zeros((1, 5))])), body


@pytest.mark.parametrize("phase", [0.0, 2.5])
def test_rays_agree_with_a_finely_stepped_world(phase):
    lidar = Lidar.even(32, (-25, 10), 1200)
    mount = Mount.degrees(0.3, 0.2, 2.0, roll=8.0, pitch=5.0, yaw=30.0)
    parts, motion, body = moving_parts()
    moments = ScanTiming(10.0).moments(lidar.scan_shares(), phase)
    hits = cast_moving(mount, lidar, parts, motion, Scan.at(moments))
    met, differ, worst = 0, 0, 0.0
    for step in range(0, lidar.fired_steps, 7):
        world = bricks(boxes_at(moments[0, step]), np.arange(len(OBJECTS), dtype=np.int32))
        still = cast(mount, lidar, world.and_(body))
        rays = np.arange(lidar.beams) * lidar.fired_steps + step
        same = hits.target[rays] == still.target[rays]
        met, differ = met + (hits.target[rays] >= 0).sum(), differ + (~same).sum()
        known = same & np.isfinite(still.range[rays])
        worst = max(worst, np.abs(hits.range[rays][known] - still.range[rays][known]).max())
        light = np.abs(hits.reflected[rays] - still.reflected[rays])[known]
        assert light.max() < 2e-3
    assert met > 300
    assert differ <= 2  # rays within 0.1 mm of an edge
    assert worst < 2e-3  # metres: of a wall hit at a slant; a turn within half a span


def test_a_pattern_agrees_with_a_finely_stepped_world():
    lidar, mount = solid_state(600), Mount(z=1.5)
    parts, motion, body = moving_parts()
    moments = ScanTiming(10.0).moments(lidar.scan_shares(), 0.0)
    hits = cast_moving(mount, lidar, parts, motion, Scan.at(moments))
    for ray in range(0, lidar.rays, 5):
        world = bricks(boxes_at(moments[ray, 0]), np.arange(len(OBJECTS), dtype=np.int32))
        still = cast(mount, lidar, world.and_(body))
        assert hits.target[ray] == still.target[ray]
        assert hits.range[ray] == pytest.approx(still.range[ray], abs=2e-3)


def test_hits_are_those_of_all_rays_at_once_where_nothing_moves():
    lidar, mount = Lidar.even(16, (-25, 5), 900), Mount(z=2.0, pitch=0.1)
    parts, motion, _ = moving_parts()
    still = Motion(np.zeros(3), np.zeros_like(motion.parts))
    moments = ScanTiming(10.0).moments(lidar.scan_shares(), 1.0)
    hits, at_once = (
        cast_moving(mount, lidar, parts, still, Scan.at(moments)),
        cast(mount, lidar, parts),
    )
    assert np.array_equal(hits.target, at_once.target)
    assert np.allclose(hits.range, at_once.range, rtol=0, atol=1e-11)


def log_of_objects(frames: int = 5, step: float = 0.1, ego: np.ndarray = EGO) -> BoxLog:
    """A log whose middle frame is at the moment 0, in a world that is turned and shifted."""
    turn, shift, rows, poses = 1.0, (100.0, -40.0), [], []
    c, s = np.cos(turn), np.sin(turn)
    for frame in range(frames):
        t = (frame - frames // 2) * step
        boxes = pd.DataFrame(boxes_at(t, ego), columns=[*OBJECTS.columns[:7]])
        rows.append(boxes.assign(frame=frame, object_id=[f"o{n}" for n in boxes.index]))
        x, y = ego[0] * t, ego[1] * t
        pose = (shift[0] + c * x - s * y, shift[1] + s * x + c * y, turn + ego[2] * t)
        poses.append((frame, 7.0 + t, *pose))
    columns = ["frame", "timestamp_s", "ego_x", "ego_y", "ego_yaw"]
    table = pd.DataFrame(poses, columns=columns).assign(scene="s", route="r", split="train")
    boxes = pd.concat(rows, ignore_index=True).assign(**{"class": "Brick", "scene": "s"})
    return BoxLog(boxes.merge(table[["frame", "timestamp_s"]], on="frame"), table)


def test_motion_of_tracks_and_poses_is_that_of_the_objects():
    motion, log = motion_in(log_of_objects()), log_of_objects()
    assert motion.frames[2] == pytest.approx(EGO, abs=1e-9)
    middle = log.boxes["frame"] == 2
    assert motion.boxes[middle] == pytest.approx(OBJECTS[["vx", "vy", "spin"]].to_numpy(), abs=1e-9)
    # At the ends of a track the difference is one-sided: here over the same straight line.
    speed = np.hypot(*motion.boxes[log.boxes["frame"] == 0, :2].T)
    assert speed == pytest.approx(np.hypot(OBJECTS["vx"], OBJECTS["vy"]), abs=1e-9)


def test_a_label_that_turns_round_does_not_spin():
    log = log_of_objects()
    flipped = log.boxes["yaw"] + np.pi * (log.boxes["frame"] == 3)
    motion = motion_in(replace(log, boxes=log.boxes.assign(yaw=flipped)))
    assert motion.boxes == pytest.approx(motion_in(log).boxes, abs=1e-9)


def cloud(timing: ScanTiming | None, log: BoxLog | None = None, **lidar) -> np.ndarray:
    model = replace(Lidar.even(16, (-15, 5), 1200, **lidar), timing=timing)
    rig = Placement("one", [Mount(z=2.0)], model)
    return collect(log or log_of_objects(), [2], rig, CROP)[0]


def test_compensation_leaves_what_stands_where_it_is():
    """A building that the vehicle passes; without compensation it is smeared."""
    corners = boxes_at(0.0)[4]
    c, s = np.cos(corners[6]), np.sin(corners[6])

    def beyond(points: np.ndarray) -> float:
        high = points[(points[:, 2] > 2.2) & (points[:, 0] > 5)]
        dx, dy = high[:, 0] - corners[0], high[:, 1] - corners[1]
        away = np.abs(np.stack([c * dx + s * dy, c * dy - s * dx], axis=1)) - corners[3:5] / 2
        return float(np.abs(away.max(axis=1)).max())

    assert beyond(cloud(ScanTiming(10.0))) < 2e-3
    assert beyond(cloud(ScanTiming(10.0, compensated=False))) > 0.1


def test_points_are_those_of_hits_at_the_poses_of_their_rays():
    timing = ScanTiming(10.0, 0.5, "right")
    lidar, mount = replace(Lidar.even(16, (-15, 5), 1200), timing=timing), Mount(z=2.0)
    moments = timing.moments(lidar.scan_shares(), 0.5)
    c, s, x, y = poses_at(moments, EGO)[0]
    rate = EGO[2] * moments[0]
    assert np.allclose([c, s, x, y], [np.cos(rate), np.sin(rate), *(EGO[:2, None] * moments[0])])
    log = log_of_objects()
    log = replace(log, boxes=log.boxes[log.boxes["object_id"] == "o0"].reset_index(drop=True))
    points = collect(log, [2], Placement("one", [mount], lidar), CROP)[0]
    points = points[(points[:, 2] > 0.2) & (points[:, 2] < 1.65)]
    # Each point is on the object where that is at the moment of some ray of its azimuth.
    off = []
    for px, py in points[:, :2]:
        step = np.arange(len(x))
        dx, dy = px - x, py - y
        azimuth = np.arctan2(c * dy - s * dx, c * dx + s * dy)
        turn = (azimuth - lidar.azimuths() + np.pi) % (2 * np.pi) - np.pi
        t = moments[0, step[np.abs(turn).argmin()]]
        box = OBJECTS.loc[0]
        dx, dy = px - box.x - box.vx * t, py - box.y - box.vy * t
        along, aside = np.cos(0.2) * dx + np.sin(0.2) * dy, np.cos(0.2) * dy - np.sin(0.2) * dx
        off.append(max(abs(along) - box.length / 2, abs(aside) - box.width / 2))
    assert len(off) > 20
    assert np.abs(off).max() < 3e-3  # a brick fills its box; points are rounded to a millimetre


def test_a_free_phase_is_drawn_in_every_frame_for_every_lidar():
    lidar = replace(Lidar.even(4, (-5, 0), 360), timing=ScanTiming(10.0, phase=None))
    rig = Placement("two", [Mount(z=2.0), Mount(x=0.1, z=2.0)], lidar)
    log = log_of_objects(ego=np.zeros(3))
    both = collect(log, [1, 2], rig, CROP)
    assert np.array_equal(collect(log, [2], rig, CROP)[0], both[1])
    locked = rig.each_lidar(lambda model: replace(model, timing=ScanTiming(10.0)))
    assert not np.array_equal(collect(log, [2], locked, CROP)[0], both[1])


def test_a_scan_starts_half_a_frame_before_the_phase():
    lidar = Lidar.even(1, (0, 0), 8)
    shares = lidar.scan_shares()
    left, right = ScanTiming(10.0).moments(shares, 0.0), ScanTiming(10.0, 0.0, "right")
    assert left[0] == pytest.approx([0, 0.0125, 0.025, 0.0375, -0.05, -0.0375, -0.025, -0.0125])
    assert right.moments(shares, 0.0)[0, 1:4] == pytest.approx([-0.0125, -0.025, -0.0375])
    quarter = ScanTiming(10.0).moments(shares, np.pi / 2)[0]
    assert quarter[[2, 0]] == pytest.approx([0.0, -0.025])
    # The view of a mirror takes the whole time.
    view = Lidar.even(1, (0, 0), 720, (-60, 60)).scan_shares()
    assert view[0, [0, -1]] == pytest.approx([-0.5, 0.5], abs=0.005)


@pytest.mark.parametrize(
    ("keys", "line"),
    [
        ({"rate_hz": 0}, "rate_hz: expected more than 0, found 0"),
        ({"phase_deg": 90}, "phase_deg: needs rate_hz"),
        ({"direction": "right"}, "direction: needs rate_hz"),
        ({"rate_hz": 10, "phase_deg": "fre"}, "phase_deg"),
    ],
)
def test_settings_that_cannot_be_are_one_line(keys, line):
    with pytest.raises(ValidationError) as error:
        SensorSettings(**keys)
    assert str(fault(error.value)).startswith(line)


def test_settings_make_the_timing():
    settings = SensorSettings(rate_hz=20, phase_deg=90, direction="right", ego_compensation=False)
    expected = ScanTiming(20.0, np.pi / 2, "right", False)
    assert settings.lidar().timing == expected
    assert SensorSettings(rate_hz=10, phase_deg="free").lidar().timing == ScanTiming(10.0, None)
    assert SensorSettings().lidar().timing is None


def test_logs_without_motion_are_one_line():
    log, timing = log_of_objects(), ScanTiming(10.0)
    without_poses = replace(log, frames=log.frames.drop(columns="ego_yaw"))
    with pytest.raises(InputError, match=r"frames: ego_yaw: missing column; a LiDAR with rate_hz"):
        cloud(timing, without_poses)
    numbers = [f"{n}" for n in range(len(log.boxes))]
    without_tracks = replace(log, boxes=log.boxes.assign(object_id=numbers))
    with pytest.raises(InputError, match="no object is in two successive frames"):
        cloud(timing, without_tracks)
    with pytest.raises(InputError, match="expected frames of a route at most 1 s apart"):
        cloud(timing, log_of_objects(step=2.0))
    assert len(cloud(None, without_poses))


def test_keys_change_with_the_timing_alone():
    lidar = Lidar.even()
    assert "timing" not in plain(lidar)
    assert plain(replace(lidar, timing=ScanTiming(10.0)))["timing"] == ScanTiming(10.0)
