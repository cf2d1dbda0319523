"""The plug-in of CARLA without a collection: its command, settings, classes and LiDARs."""

import math
import re
import socket
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.refused import refused

pytest.importorskip("carla")

from lidarplace.plugins.carla.command import Collection, app
from lidarplace.plugins.carla.drive import object_class, starts
from lidarplace.plugins.carla.lidars import ego_points, mount_transform
from lidarplace.plugins.carla.server import check_versions
from lidarplace.plugins.carla.settings import CarlaScene
from lidarplace.rig_files.carla import attributes, even_fans
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import PAPER_PLACEMENTS, Mount
from tests.lidarplace.carla_world import Server, cast
from tests.sweeps.toy import call


def test_command_without_a_server(tmp_path):
    config = tmp_path / "carla.yaml"
    config.write_text("scene: {towns: [Town01], timeout_s: 0.5}\nplacements: {line: null}\n")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = f"{config} {tmp_path}/out --host 127.0.0.1 --port {port}"
    done = call(app, *command.split(), code=2)
    (line,) = done.stderr.splitlines()
    assert f"no CARLA server answers at 127.0.0.1:{port} within 0.5 s" in line


@pytest.mark.parametrize("version", ["0.9.10.1", "0.9.15-dirty"])
def test_versions_must_match(version):
    release = version[:6].rstrip(".-")
    told = f"expected 0.9.16, found {version}; pip install carla=={release},"
    with refused(("CARLA server at ", "", version), told):
        check_versions(Server(version=version), CarlaScene())
    check_versions(Server(version="0.9.16-3-gabc"), CarlaScene())  # a build of the same version


@pytest.mark.parametrize(
    ("blueprint", "wheels", "size", "expected"),
    [
        ("vehicle.carlamotors.carlacola", 4, (5.2, 2.6, 2.5), "Cyclist"),
        ("vehicle.diamondback.century", 2, (1.6, 0.6, 1.2), "Cyclist"),
        ("vehicle.volkswagen.t2", 4, (4.5, 2.1, 2.0), "Car"),
        ("vehicle.tesla.cybertruck", 4, (6.3, 2.4, 2.1), "Car"),
        ("vehicle.mercedes.sprinter", 4, (5.9, 2.0, 2.6), "Cyclist"),
        ("vehicle.new.scooter", 2, (1.8, 0.8, 1.5), "Cyclist"),
        ("vehicle.new.lorry", 4, (8.0, 2.5, 3.0), "Cyclist"),
        ("vehicle.new.limousine", 4, (8.0, 2.5, 1.5), "Car"),
        ("walker.pedestrian.0015", 0, (0.4, 0.4, 1.8), "Pedestrian"),
    ],
)
def test_classes(blueprint, wheels, size, expected):
    assert object_class(blueprint, wheels, size, {}) == expected
    assert object_class(blueprint, wheels, size, {blueprint: "Car"}) == "Car"


def test_plan_numbers_routes_and_frames_and_shares_no_start_and_starts_lie_far_apart():
    scene = CarlaScene(towns=("Town01", "Town03"), routes=3, test_routes=2)
    plan = scene.plan()
    assert [route.part for route in plan] == ["train"] * 6 + ["test"] * 4
    assert [route.number for route in plan] == list(range(10))
    assert all(b.first_frame - a.first_frame == 200 for a, b in pairwise(plan))
    assert len({(route.town, route.start) for route in plan}) == 10
    assert len({route.seed for route in plan}) == 10

    points = [(x, y) for x in range(0, 100, 10) for y in range(0, 100, 10)]
    taken = [points[starts(points, count, scene, plan[0])] for count in range(1, 6)]
    apart = [np.hypot(a[0] - b[0], a[1] - b[1]) for a in taken for b in taken if a != b]
    assert len(set(taken)) == 5
    assert min(apart) > 40


def test_settings_in_the_documentation():
    page = (Path(__file__).parents[2] / "docs/carla.md").read_text()
    blocks = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    short, paper = (Collection.model_validate(yaml.safe_load(block)) for block in blocks)
    assert list(short.rigs()) == ["line_roll", "mine"]
    assert len(paper.rigs()) == 8
    assert len(paper.scene.plan()) * paper.scene.frames_per_route == 44_000


def test_placements_of_a_settings_file():
    rigs = Collection.model_validate(
        {
            "lidar": {"elevations": [-0.2, 0.0], "azimuth_steps": 100},
            "placements": {"line_roll": None, "mine": {"mounts": [{"z": 2.0, "pitch": 0.1}]}},
        }
    ).rigs()
    assert [rig.lidar.beams for rig in rigs.values()] == [2, 2]
    assert rigs["mine"].mounts[0].pitch == 0.1
    named = Collection.model_validate({"lidar": "VLP-16", "placements": {"line": None}}).rigs()
    assert named["line"].lidar == Lidar.named("vlp16")


PAPER = Lidar.paper()


def all_points(lidar, mount):
    """Of a LiDAR alone on the plane of the world in memory."""
    (fan,) = even_fans(lidar.elevations)
    known = {"atmosphere_attenuation_rate": "0.004"} | attributes(lidar, fan, seed=0)
    matrix = np.array(mount_transform(mount, (0, 0)).get_matrix())
    returns = cast(SimpleNamespace(attributes=known, matrix=matrix), [])
    return ego_points(returns, mount, lidar, (-np.inf,) * 3 + (np.inf,) * 3, (-1.0, -1.0, -1.0))


def test_the_papers_beam_table_is_one_sensor():
    (fan,) = even_fans(PAPER.elevations)
    values = {name: float(value) for name, value in attributes(PAPER, fan, seed=5).items()}
    assert values["channels"] == 16
    assert values["points_per_second"] == 90_000 * 20
    assert (values["lower_fov"], values["upper_fov"]) == pytest.approx((-25, 5), abs=1e-6)
    assert values["rotation_frequency"] == 20
    assert values["dropoff_general_rate"] == values["dropoff_zero_intensity"] == 0
    values = attributes(PAPER, even_fans(PAPER.elevations)[0], seed=2**31 + 5)
    found = [values[name] for name in ("channels", "points_per_second", "noise_seed")]
    assert found == ["16", "1800000", "5"]
    assert attributes(PAPER, even_fans([0.0])[0], seed=2**31 - 1)["noise_seed"] == "2147483647"


@settings(derandomize=True)
@given(st.lists(st.floats(-math.pi / 2, math.pi / 2), min_size=1, max_size=40))
def test_fans_hold_every_beam_once(elevations):
    fans = even_fans(elevations)
    beams = np.concatenate([np.linspace(fan.lower, fan.upper, fan.beams) for fan in fans])
    np.testing.assert_allclose(np.sort(beams), np.sort(elevations), atol=1e-6)
    assert len(fans) <= (len(elevations) + 1) // 2


@pytest.mark.parametrize("mount", PAPER_PLACEMENTS["pyramid_roll"].mounts)
def test_mount_in_carlas_own_matrix(mount):
    pose = np.array(mount_transform(mount, (0.0, 0.0)).get_matrix())
    mirror = np.diag([1, -1, 1])
    np.testing.assert_allclose(mirror @ pose[:3, :3] @ mirror, mount.rotation, atol=1e-6)
    np.testing.assert_allclose(mirror @ pose[:3, 3], mount.position, atol=1e-6)


def test_returns_of_a_tilted_lidar_lie_on_a_plane_in_the_ego_frame():
    # The world's plane rises along x by 4 degrees, and the ego stands level at its foot.
    lidar = Lidar((-0.4, -0.1), azimuth_steps=90)
    points = all_points(lidar, Mount(0.2, 0.6, 2.2, roll=-0.28, pitch=0.1, yaw=1.0))
    assert len(points) > 60
    rise = math.tan(math.radians(4))
    np.testing.assert_allclose(points[:, 2], rise * points[:, 0], atol=2e-4)


def test_field_of_view_is_cut_from_the_full_turn():
    lidar = Lidar((-0.3,), azimuth_steps=360, azimuth=(math.radians(80), math.radians(200)))
    points = all_points(lidar, Mount(z=2.0))
    turned = np.degrees(np.arctan2(points[:, 1], points[:, 0])) % 360
    assert turned.min() >= 80 - 1e-3
    assert turned.max() <= 200 + 1e-3
    assert abs(len(points) - lidar.fired_steps) <= 2  # rounding in float32 at the two ends


def test_crop_and_own_body():
    points = np.array(
        [[0, 0, 1.0, 1], [2.3, 0, 0.5, 1], [2.6, 0, 0.5, 1], [10, 3, 0, 1], [10.1, 0, 0, 1]],
        np.float32,
    )
    lidar = Lidar((0.0,), azimuth_steps=8)
    kept = ego_points(points, Mount(), lidar, (-10, -10, -1, 10, 10, 3), (4.6, 2.0, 1.5))
    np.testing.assert_array_equal(kept, points[[2, 3]] * [1, -1, 1, 1])  # y to the left
