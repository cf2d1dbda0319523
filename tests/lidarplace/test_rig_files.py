"""Rigs through the files of other tools and back, and files that others wrote."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lidarplace.commands.rig import app
from lidarplace.configuration.placement import read_placement
from lidarplace.configuration.sensor import SensorSettings
from lidarplace.rig_files.formats import FORMATS, format_of
from lidarplace.rig_files.mounted import RigSensor, lidars_in
from lidarplace.rig_files.mounts_yaml import read_mounts_yaml, write_mounts_yaml
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount
from lidarplace.rigs.pose import angles, rotation
from lidarplace.rigs.rotations import order_caution, rotations, rotations_of
from tests.lidarplace.nuscenes_layout import Sample, Scene, write_nuscenes
from tests.refused import refused
from tests.sweeps.toy import call

DATA = Path(__file__).parents[1] / "data/rigs"
QUARTER = math.pi / 2
ANGLE = st.one_of(
    st.floats(-math.pi, math.pi),
    st.sampled_from([0.0, QUARTER, -QUARTER, math.pi]),
    st.floats(-1e-7, 1e-7).map(lambda hair: QUARTER + hair),  # about the lock of the gimbal
    st.floats(-1e-16, 1e-16).map(lambda hair: -QUARTER + hair),
)
METRES = st.floats(-5, 5)
MOUNT = st.builds(Mount, METRES, METRES, st.floats(0, 5), ANGLE, ANGLE, ANGLE)


@given(ANGLE, ANGLE, ANGLE)
def test_angles_of_a_rotation_are_the_same_rotation(roll, pitch, yaw):
    matrix = rotation(roll, pitch, yaw)
    found = angles(matrix)
    np.testing.assert_allclose(rotation(*found), matrix, atol=2e-15)
    assert abs(found[1]) <= QUARTER
    ours = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix()
    np.testing.assert_allclose(ours, matrix, atol=2e-15)


def assert_alike(found, expected, tolerance):
    assert [lidar.name for lidar in found] == [lidar.name for lidar in expected]
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_allclose(a.mount.position, b.mount.position, atol=tolerance)
        np.testing.assert_allclose(a.mount.rotation, b.mount.rotation, atol=tolerance)


def written_and_read(name, path, rig):
    if name == "own":
        write_mounts_yaml(path, rig)
        return read_mounts_yaml(path)
    FORMATS[name].write(path, rig)
    return FORMATS[name].read(path, ["*"])


@pytest.mark.parametrize("name", ["own", *FORMATS])
@settings(max_examples=30)
@given(mounts=st.lists(MOUNT, min_size=1, max_size=3, unique_by=lambda mount: mount.x))
def test_poses_come_back(name, mounts, tmp_path_factory):
    path = tmp_path_factory.mktemp("rigs") / "rig.urdf"
    model = SensorSettings(name="vlp16")
    rig = [RigSensor(f"lidar_{i}", mount, model) for i, mount in enumerate(mounts, 1)]
    assert_alike(written_and_read(name, path, rig), rig, 1e-9)


@pytest.mark.parametrize("kind", [np.float64, np.float32, np.int64])
@pytest.mark.parametrize("name", ["own", *FORMATS])
def test_numbers_of_numpy_are_written_as_plain_ones(name, kind, tmp_path):
    mount = Mount(*np.array([1.5, -0.25, 2, 0.5, 0, 1]).astype(kind))
    rig = [RigSensor("lidar_1", mount, SensorSettings(name="vlp16"))]
    assert_alike(written_and_read(name, tmp_path / "rig", rig), rig, 1e-9)
    assert not any(b"np." in f.read_bytes() for f in tmp_path.rglob("*") if f.is_file())


@pytest.mark.parametrize(
    "settings_",
    [
        {"name": "vlp32c"},  # uneven beams: several of CARLA's sensors
        {"beams": 1, "elevation_deg": [0, 0], "azimuth_steps": 900},
        {"azimuth_deg": [-60, 60], "azimuth_steps": 1800, "range": 50, "range_noise": 0.02},
        {"beams": 32, "drop_off": 0.1, "azimuth_steps": 1000},
    ],
)
def test_carla_keeps_rays(settings_, tmp_path):
    model = SensorSettings(**settings_)
    rig = [RigSensor("roof", Mount(z=2.0), model), RigSensor("b", Mount(x=1, z=2), model)]
    FORMATS["carla"].write(tmp_path / "objects.json", rig)
    found = FORMATS["carla"].read(tmp_path / "objects.json", [])
    assert [lidar.name for lidar in found] == ["roof", "b"]
    asked, back = model.lidar(), found[1].model.lidar()
    assert (back.azimuth_steps, back.fired_steps) == (asked.azimuth_steps, asked.fired_steps)
    np.testing.assert_allclose(back.elevations, asked.elevations, atol=1e-6)
    for name in ("range", "range_noise", "drop_off", "azimuth"):
        np.testing.assert_allclose(getattr(back, name), getattr(asked, name), atol=1e-9)


def test_the_own_file_keeps_models_and_is_a_placement(tmp_path):
    changed = SensorSettings(name="at128", range=90.0)
    rig = [
        RigSensor("top", Mount(z=2.0), SensorSettings(name="vlp16")),
        RigSensor("front", Mount(x=2, z=1), changed),
        RigSensor("own", Mount(x=1, z=1), SensorSettings(beams=4)),
        RigSensor("any", Mount(x=3, z=1)),
    ]
    path = tmp_path / "rig.yaml"
    write_mounts_yaml(path, rig)
    assert [lidar.model for lidar in read_mounts_yaml(path)] == [lidar.model for lidar in rig]
    assert "lidar: vlp16" in path.read_text()
    placed = read_placement(path, Lidar.paper())
    assert placed.lidars[0] == Lidar.named("vlp16")
    assert placed.lidars[3] == Lidar.paper()


def found_by_command(*arguments):
    return call(app, *arguments)


def test_a_urdf_of_another_library(tmp_path):
    out = tmp_path / "rig.yaml"
    found_by_command(DATA / "car.urdf", out, "--origin", -1.4, 0, 0.3, "--only", "LIDAR_*")
    top, left = read_mounts_yaml(out)
    # By hand: the roof is turned to the left by a quarter, so its x is the vehicle's y.
    np.testing.assert_allclose(top.mount.position, [0.5 - 1.4, 0.2, 1.4 + 0.5 + 0.3], atol=1e-9)
    np.testing.assert_allclose(top.mount.rotation, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(left.mount.position, [0.5 - 1.4, 0.8, 1.4 + 0.1 + 0.3], atol=1e-9)
    expected = Mount.degrees(0, 0, 0, 0, math.degrees(0.3), math.degrees(0.1) + 90)
    np.testing.assert_allclose(left.mount.rotation, expected.rotation, atol=1e-9)


def test_an_osi_configuration_of_another_library(tmp_path):
    out = tmp_path / "rig.yaml"
    command = DATA / "sensor_view_configuration.json", out, "--format", "osi", "--origin"
    found_by_command(*command, -1.4, 0, 0.3, "--lidar", "vlp16")
    (lidar,) = read_mounts_yaml(out)
    assert (lidar.name, lidar.model.name) == ("lidar_7", "vlp16")
    np.testing.assert_allclose(lidar.mount.position, [0, 0, 1.8], atol=1e-9)
    np.testing.assert_allclose(lidar.mount.rotation, rotation(0.1, -0.2, 3.0), atol=1e-9)
    told = found_by_command(*command, 0, 0, -1.6).stderr
    assert "warning: lidar_7 is 0.1 m under the ground" in told


def test_the_messages_own_names_are_read_as_well(tmp_path):
    path = tmp_path / "view.json"
    place = {"position": {"x": 1.0}, "orientation": {"yaw": 0.5}}
    path.write_text(json.dumps({"lidar_sensor_view_configuration": [{"mounting_position": place}]}))
    (lidar,) = FORMATS["osi"].read(path, [])
    assert lidar == RigSensor("lidar_0", Mount(x=1.0, yaw=0.5))


LAUNCH = """<launch>
  <node pkg="tf2_ros" exec="static_transform_publisher"
    args="0 0 1.5 1.5707963267948966 0 0 base_link roof"/>
  <group>
    <node pkg="tf2_ros" exec="static_transform_publisher"
      args="--x 1 --qz 1 --qw 0 --frame-id roof --child-frame-id lidar"/>
  </group>
  <node pkg="tf2_ros" type="static_transform_publisher" args="1 2 3 0 0 0 1.005 base_link other"/>
  <node pkg="camera" exec="driver"/>
</launch>"""


def test_transforms_by_order_and_by_name(tmp_path):
    path = tmp_path / "car.launch.xml"
    path.write_text(LAUNCH)
    lidar, other = FORMATS["ros2"].read(path, ["lidar", "o*"])
    # Yaw comes first of the angles: a quarter to the left, then half a turn.
    np.testing.assert_allclose(lidar.mount.position, [0, 1, 1.5], atol=1e-12)
    np.testing.assert_allclose(lidar.mount.rotation, rotation(0, 0, -QUARTER), atol=1e-12)
    assert other == RigSensor("other", Mount(1, 2, 3))


BRIDGE = """{"objects": [
  {"type": "sensor.pseudo.markers", "id": "markers"},
  {"type": "vehicle.audi.tt", "id": "ego_vehicle", "sensors": [
    {"type": "sensor.camera.rgb", "id": "rgb", "spawn_point": {"x": 2.0}, "fov": 90.0},
    {"type": "sensor.lidar.ray_cast", "id": "lidar",
     "spawn_point": {"x": 0.5, "y": 0.7, "z": 2.4, "pitch": 20.0, "yaw": 90.0},
     "range": 50, "channels": 32, "points_per_second": 320000, "upper_fov": 2.0,
     "lower_fov": -26.8, "rotation_frequency": 20}]}]}"""
"""In the layout of the bridge's own example."""


def test_objects_of_carlas_bridge(tmp_path):
    path = tmp_path / "objects.json"
    path.write_text(BRIDGE)
    (lidar,) = FORMATS["carla"].read(path, [])
    assert lidar.mount == Mount.degrees(0.5, 0.7, 2.4, 0, 20, 90), "right-handed, as ROS is"
    model = lidar.model.lidar()
    assert model.azimuth_steps == 320000 / 32 / 20
    np.testing.assert_allclose(np.degrees(model.elevations), np.linspace(-26.8, 2, 32))
    assert (model.range, model.drop_off) == (50, 0.45), "of CARLA, where the file is silent"


def test_a_rotation_that_is_none_is_refused():
    """A quaternion of length 0.9, a matrix that scales, shears or mirrors; rounding passes."""
    right, row = Rotation.random(3, rng=1), "row {}".format
    for close in (right.as_quat(), right.as_quat() * 1.009, right.as_quat().astype("f4")):
        np.testing.assert_allclose(rotations(close).as_matrix(), right.as_matrix(), atol=1e-6)
    close = rotations_of(right.as_matrix().round(4))
    assert (right * close.inv()).magnitude().max() < 1e-3
    for factor in (0.0, 0.9, 1.02, np.nan):
        with refused(("row 2", "", f"{factor:g}")):
            rotations(right.as_quat() * [[1], [1], [factor]], row)
    for wrong in (0.9 * np.eye(3), np.diag([1, 1, -1]), np.eye(3) + 0.1 * np.eye(3, k=1)):
        with refused(("row 1", "", "")):
            rotations_of(np.stack([np.eye(3), wrong, np.eye(3)]), row)


@pytest.mark.parametrize("yaws", [(40,), (0, 90, -120)])
def test_the_other_order_of_a_quaternion_tilts_level_lidars(yaws):
    right = Rotation.from_euler("zx", [(yaw, 0) for yaw in yaws], degrees=True)
    wrong = Rotation.from_quat(right.as_quat(), scalar_first=True).as_matrix()
    names = [f"l{n}" for n in range(len(yaws))]
    assert order_caution(names, right.as_matrix()) == []
    (said,) = order_caution(names, wrong)
    assert "l0" not in said or yaws[0] != 0
    for rolls in ((90, -90), (0, 180)):  # on the sides, or one on its head: this may be meant
        turned = Rotation.from_euler("xy", [(roll, 0) for roll in rolls], degrees=True)
        assert order_caution("ab", turned.as_matrix()) == []


def test_calibrations_of_nuscenes(tmp_path):
    write_nuscenes(tmp_path / "v1", [Scene(f"scene-{n}", [Sample(5)], f"l{n}") for n in "ab"], [])
    table = tmp_path / "v1/calibrated_sensor.json"
    found_by_command(tmp_path / "v1", tmp_path / "rig.yaml", "--format", "nuscenes")
    (lidar,) = lidars_in(read_mounts_yaml(tmp_path / "rig.yaml"))
    rows, sensors = (json.loads(p.read_text()) for p in (table, tmp_path / "v1/sensor.json"))
    channels = {row["token"]: row["channel"] for row in sensors}
    own = [row for row in rows if channels[row["sensor_token"]] == "LIDAR_TOP"]
    expected = np.array(own[0]["translation"]) - [2.588 / 2, 0, 0]
    np.testing.assert_allclose(lidar.mount.position, expected, atol=1e-9)

    own[0]["translation"] = [1.0, 0.0, 1.9]
    if len(own) == 1:
        rows.append({**own[0], "token": "another", "translation": [0.9, 0.0, 1.9]})
    table.write_text(json.dumps(rows))
    done = call(app, str(tmp_path / "v1"), "out.yaml", "--format", "nuscenes", code=2)
    assert "calibrated_sensor.json: LIDAR_TOP: " in done.output
    chosen = re.search(r"--only (LIDAR_TOP\.\S+)", done.output)[1]
    (lidar,) = FORMATS["nuscenes"].read(tmp_path / "v1", [chosen])
    assert lidar.name == "LIDAR_TOP"


def test_autowares_pair_of_files(tmp_path):
    """The kit is turned to the left by a quarter, so its x is the vehicle's y."""
    kit = {"velodyne_top_base_link": {"x": 0.5, "z": 0.2}, "camera0/camera_link": {"y": 0.1}}
    place = {"x": 0.9, "y": 0.0, "z": 2.0, "roll": 0.0, "pitch": 0.0, "yaw": math.pi / 2}
    kits = {"sensor_kit_base_link": place, "rear_base_link": {"x": -0.4, "z": 1.6}}
    for name, content in (
        ("sensors", {"base_link": kits}),
        ("sensor_kit", {"sensor_kit_base_link": kit}),
    ):
        (tmp_path / f"{name}_calibration.yaml").write_text(json.dumps(content))
    words = ("--origin", -1.4, 0, 0, "--only", "velodyne*", "--only", "rear*")
    for source in (tmp_path / "sensor_kit_calibration.yaml", tmp_path):
        by_name = () if source.suffix else ("--format", "autoware")
        found_by_command(source, tmp_path / "rig.yaml", *words, *by_name)
        rear, top = sorted(read_mounts_yaml(tmp_path / "rig.yaml"), key=lambda each: each.name)
        np.testing.assert_allclose(top.mount.position, [0.9 - 1.4, 0.5, 2.2], atol=1e-9)
        np.testing.assert_allclose(top.mount.yaw, math.pi / 2, atol=1e-9)
        np.testing.assert_allclose(rear.mount.position, [-1.8, 0, 1.6], atol=1e-9)
    (tmp_path / "sensors_calibration.yaml").unlink()
    with refused("no frame base_link; add sensors_calibration.yaml"):
        FORMATS["autoware"].read(tmp_path, ["*"])


def test_ros_1_and_programs(tmp_path):
    """As ROS 1's own package writes it: a slash before frames, a period in the end."""
    path = tmp_path / "a.launch"
    node = '<node pkg="{}" type="static_transform_publisher" args="{}"/>'
    front = node.format("tf", "1 0 2 0 0.02 0 /base_link /velodyne 100")
    rear = node.format("tf2_ros", "-1 0 1.5 3.14 0 0 base_link rear")
    path.write_text(f"<launch>{front}{rear}</launch>")
    a, b = FORMATS["ros2"].read(path, ["*"])
    assert (a.name, a.mount.x, a.mount.pitch) == ("velodyne", 1.0, pytest.approx(0.02))
    assert (b.name, b.mount.x) == ("rear", -1.0)
    path.write_text(f"<launch>{node.format('other', '1 0 2 0 0 0 base_link a')}</launch>")
    with refused("transform 0: unknown package .*expected tf2_ros or tf, found other"):
        FORMATS["ros2"].read(path, ["*"])
    for name, message in (("a.launch.py", "ros2 param get"), ("a.urdf.xacro", "xacro FILE >")):
        with refused(f"a program, which is not executed; .*{message}"):
            format_of(Path(name), None)
