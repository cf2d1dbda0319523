"""Cameras and radars: what they have of objects by hand, in requirements, and through files."""

import math
from dataclasses import replace

import numpy as np
import pytest

from lidarplace import Lidar, Mount, Placement
from lidarplace.commands.rig import app
from lidarplace.configuration.further_sensors import (
    CameraSettings,
    RadarSettings,
    further_catalogue,
    further_sensors,
)
from lidarplace.mounting.common_view import CommonView, common_view
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.requirements.area import Area
from lidarplace.requirements.cameras_and_radars import measure_each
from lidarplace.requirements.check_requirements import by_several, check_requirements
from lidarplace.requirements.layout import lay_out
from lidarplace.requirements.requirement import AlsoWhen, PlacedObject, Requirement
from lidarplace.rig_files.formats import FORMATS
from lidarplace.rig_files.mounted import RigSensor
from lidarplace.rig_files.mounts_yaml import read_mounts_yaml, write_mounts_yaml
from tests.sweeps.toy import call

NOTHING = Vehicle("nothing", np.empty((0, 2, 3)))
CAR = Vehicle.car()
RIG = Placement("roof", [Mount(z=1.8)], Lidar.even(8, azimuth_steps=360))


def camera(**changes):
    pose = {"x": 0.0, "z": 1.0}
    return CameraSettings(**(pose | {"pixels": (1000, 500), "fov_deg": (90.0, 60.0)} | changes))


def radar(**changes):
    limits = {"azimuth_deg": (-45.0, 45.0), "elevation_deg": (-10.0, 10.0), "range": 50.0}
    return RadarSettings(**({"x": 0.0, "z": 1.0} | limits | changes))


def sensors_of(*settings):
    mounts = [Mount(*sensor.pose) for sensor in settings]
    cameras = [sensor for sensor in settings if isinstance(sensor, CameraSettings)]
    return further_sensors(
        cameras, [sensor for sensor in settings if sensor not in cameras], mounts
    )


def on(settings, *boxes, vehicle=NOTHING, object_class=None):
    sensors = sensors_of(settings)
    return measure_each(sensors, np.array(boxes, np.float64), object_class, RIG, vehicle)[:, 0]


def test_pixels_of_a_wall_by_hand():
    """90 degrees on 1,000 pixels are 500 pixels for a slope of 1; 60 degrees on 500 are 433."""
    wall = [10.5, 0.0, 1.0, 1.0, 2.0, 2.0, 0.0]  # its front is 10 m ahead
    pixels = on(camera(), wall)[0]
    assert pixels == pytest.approx(min(500 * 2 / 10, 433.01 * 2 / 10), rel=1e-4)
    flat = [10.5, 0.0, 1.0, 1.0, 2.0, 0.5, 0.0]
    assert on(camera(), flat)[0] == pytest.approx(433.01 * 0.5 / 10, rel=1e-4)
    behind, aside = [-10.5, *wall[1:]], [10.5, 15.0, *wall[2:]]
    assert on(camera(), behind, aside).tolist() == [0.0, 0.0]
    far = camera(range=9.0)
    assert on(far, wall)[0] == 0.0
    by_class = camera(range=9.0, ranges={"Car": 30.0})
    assert on(by_class, wall, object_class="Car")[0] == pytest.approx(pixels)
    turned = camera(yaw_deg=180.0)
    assert on(turned, behind)[0] == pytest.approx(pixels)
    fx, fy = 500.0, 250 / math.tan(math.radians(30))
    k = ((fx, 0.0, 500.0), (0.0, fy, 250.0), (0.0, 0.0, 1.0))
    assert on(camera(fov_deg=None, intrinsic=k), wall)[0] == pytest.approx(pixels)


def test_reach_of_a_radar_is_range_by_distance():
    box = [20.5, 0.0, 1.0, 1.0, 1.0, 1.0, 0.0]
    assert on(radar(), box)[0] == pytest.approx(50 / 20)
    assert on(radar(ranges={"Pedestrian": 19.0}), box, object_class="Pedestrian")[0] == 0.0
    assert on(radar(ranges={"Pedestrian": 30.0}), box, object_class="Pedestrian")[0] == 30 / 20
    assert on(radar(), [5.0, 0.0, 6.0, 1.0, 1.0, 1.0, 0.0])[0] == 0.0  # above its 10 degrees


def test_a_body_hides_but_not_from_what_is_within_it():
    """A camera behind the windscreen and a radar behind the bumper look out of their boxes."""
    ahead, behind = [8.0, 0.0, 0.85, 0.6, 0.6, 1.7, 0.0], [-8.0, 0.0, 0.85, 0.6, 0.6, 1.7, 0.0]
    screen = camera(x=0.5, z=1.3)
    assert on(screen, ahead, vehicle=CAR)[0] > 0.5 * on(screen, ahead)[0]
    bumper = radar(x=2.2, z=0.5)
    assert on(bumper, ahead, vehicle=CAR)[0] == on(bumper, ahead)[0] > 1
    roof = camera(x=0.9, z=1.55, yaw_deg=180.0)
    low = [-3.0, 0.0, 0.2, 0.3, 0.3, 0.4, 0.0]
    assert on(roof, low)[0] > 0
    assert on(roof, low, vehicle=CAR)[0] == 0
    assert on(roof, behind, vehicle=CAR)[0] > 0


def test_by_kinds_against_all_sets():
    """The largest threshold at which enough sensors of enough kinds have that much."""
    random = np.random.default_rng(1)
    kinds = ["lidar", "lidar", "camera", "camera", "radar"]
    each = random.integers(0, 9, (200, 5)).astype(np.float64)
    for sensors, of, dead in [(1, 1, ()), (2, 2, ()), (3, 2, (0,)), (3, 3, ()), (2, 3, (4,))]:
        left = [n for n in range(5) if n not in dead]
        largest = by_several(each, kinds, left, sensors, of)
        for row, value in zip(each, largest, strict=True):
            have = {t: [n for n in left if row[n] >= t] for t in row}
            enough = [t for t, n in have.items() if len(n) >= sensors]
            enough = [t for t in enough if len({kinds[n] for n in have[t]}) >= of]
            assert value == max(enough, default=0.0)


def test_a_requirement_of_two_kinds():
    """Ahead a LiDAR, a camera and a radar see somebody, behind the LiDAR alone."""
    placed = PlacedObject(0.6, 0.6, 1.7, headings=1)
    further = sensors_of(camera(z=1.6), radar(z=0.6, x=2.3))
    needs = (("points", 4.0), ("pixels", 20.0), ("reach", 1.0))
    ahead, behind = Area(x=(6.0, 8.0), y=((-1.0, 1.0),)), Area(x=(-8.0, -6.0), y=((-1.0, 1.0),))

    def check(area, **wanted):
        requirement = Requirement("x", area, "times the need", 1.0, placed, needs=needs, **wanted)
        return check_requirements([lay_out(requirement, CAR)], RIG, CAR, further)[0]

    assert check(ahead, sensors=3, kinds=3).met
    assert check(behind, sensors=1).met
    assert check(behind, sensors=2, kinds=2).worst.value == 0.0
    dead = check(ahead, sensors=2, kinds=2, also_when=AlsoWhen(sensors_dead=1))
    assert [finding.case for finding in dead.cases] == [
        "as built", "without LiDAR 1", "without camera 1", "without radar 1",
    ]  # fmt: skip
    assert dead.met
    assert not check(ahead, sensors=2, also_when=AlsoWhen(sensors_dead=2)).met
    assert dead.requirement.measured == "times the need by 2 sensors of 2 kinds"


def test_a_camera_shares_its_view_with_a_lidar_that_turns():
    further = sensors_of(camera(z=1.7), camera(name="rear", z=1.7, yaw_deg=180.0))
    rig = Placement("wide", [Mount(z=1.9)], Lidar.even(8, (-40, 40), azimuth_steps=360))
    shares = common_view(rig, NOTHING, CommonView("all", 0.5, 20.0), further)
    assert shares[0, 1] > 0.99
    assert shares[1, 2] == 0.0


FURTHER = [
    RigSensor("lidar_1", Mount(z=2.0)),
    RigSensor("camera_1", Mount(1.7, 0.1, 1.5, 0.01, -0.02, 0.9), further=camera()),
    RigSensor("camera_2", Mount(-1.0, 0.1, 1.5, 0.0, 0.1, 3.0), further=camera()),
    RigSensor("radar_1", Mount(3.4, -0.2, 0.5, 0.1, 0.0, -1.2), further=radar()),
]


@pytest.mark.parametrize("name", ["own", "nuscenes", "osi"])
def test_cameras_and_radars_come_back(name, tmp_path):
    path, ours = tmp_path / "rig.yaml", name == "own"
    write = write_mounts_yaml if ours else FORMATS[name].write
    write(path, FURTHER)
    back = read_mounts_yaml(path) if ours else FORMATS[name].read(path, [])
    assert [(sensor.name, sensor.kind) for sensor in back] == [
        (sensor.name, sensor.kind) for sensor in FURTHER
    ]
    for sensor, before in zip(back, FURTHER, strict=True):
        np.testing.assert_allclose(sensor.mount.position, before.mount.position, atol=1e-9)
        np.testing.assert_allclose(sensor.mount.rotation, before.mount.rotation, atol=1e-9)
    one, two = back[1].further.built(), FURTHER[1].further.built()
    np.testing.assert_allclose(one.focal, two.focal, rtol=1e-6)
    if ours:
        assert back[3].further.built() == FURTHER[3].further.built()


@pytest.mark.parametrize("name", ["urdf", "ros2"])
def test_frames_that_are_cameras_are_named(name, tmp_path):
    optical = replace(FURTHER[1], name="cam_optical_frame")
    source = tmp_path / {"urdf": "rig.urdf", "ros2": "rig.launch.xml"}[name]
    FORMATS[name].write(source, [*FURTHER, optical])
    words = "--only lidar* --cameras cam* --radars radar* --origin 0 0 0 --camera a2d2_front_camera"
    command = f"{source} {tmp_path}/o.yaml {words} --radar drvegrd169"
    call(app, *command.split())
    sensors = {sensor.name: sensor for sensor in read_mounts_yaml(tmp_path / "o.yaml")}
    np.testing.assert_allclose(
        sensors["cam_optical_frame"].mount.rotation, optical.mount.rotation, atol=1e-9
    )
    assert sensors["radar_1"].further.built().ranges == (("", 130.0),)
    assert [name for name, sensor in sensors.items() if sensor.kind == "lidar"] == ["lidar_1"]


def test_what_the_catalogue_holds_can_be_built_and_has_a_source():
    for name, keys in further_catalogue().items():
        kind = CameraSettings if keys["kind"] == "camera" else RadarSettings
        settings = kind(z=1.0, model=name)
        assert settings.built() is not None
        assert "http" in settings.source
