import re
import socket
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

pytest.importorskip("carla")

from carla_world import Server

from lidarplace.plugins.carla.command import Collection, app
from lidarplace.plugins.carla.drive import object_class, starts
from lidarplace.plugins.carla.server import check_versions, connect
from lidarplace.plugins.carla.settings import CarlaScene
from lidarplace.rigs.lidar import Lidar


def closed_port():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


def test_no_server_is_an_error_within_the_timeout():
    scene = CarlaScene(host="127.0.0.1", port=closed_port(), timeout_s=0.5)
    with pytest.raises(ConnectionError, match=r"no CARLA server answers at 127.* within 0\.5 s"):
        connect(scene)


def test_command_without_a_server(tmp_path):
    config = tmp_path / "carla.yaml"
    config.write_text("scene: {towns: [Town01], timeout_s: 0.5}\nplacements: {line: null}\n")
    port = str(closed_port())
    command = [str(config), str(tmp_path / "out"), "--host", "127.0.0.1", "--port", port]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 2
    (line,) = done.stderr.splitlines()
    assert f"127.0.0.1:{port}" in line


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("scene: {densty: 3}", "scene.densty: unknown key, found 3"),
        ("scene: [", "is not YAML"),
        ("placements: {mine: null}", "mine has no mounts"),
        ("placements: {a: {mounts: [{z: 2}, {z: 2}]}}", "two LiDARs cannot sit in one place"),
        ("placements: {a: {mounts: [{x: 0, z: 2, height: 2}]}}", "height: unknown key, found 2"),
        ("scene: {classes: {vehicle.a.b: a truck}}", "found 'a truck'"),
        ("scene: {crop: [0, 0, 0, 0, 1, 1]}", "crop needs x0 < x1"),
        ("lidar: vlp61", "did you mean vlp16?"),
        ("- 1", "found [1]"),
    ],
)
def test_command_with_a_wrong_file(tmp_path, content, message):
    config = tmp_path / "carla.yaml"
    config.write_text(content)
    done = CliRunner().invoke(app, [str(config), str(tmp_path / "out")])
    assert done.exit_code == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith(str(config))
    assert message in line


@pytest.mark.parametrize("version", ["0.9.10.1", "0.9.15-dirty"])
def test_versions_must_match(version):
    release = version[:6].rstrip(".-")
    with pytest.raises(ValueError, match=rf"version {version}.*0\.9\.16.*carla=={release},"):
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


def test_plan_numbers_routes_and_frames_and_shares_no_start():
    scene = CarlaScene(towns=("Town01", "Town03"), routes=3, test_routes=2)
    plan = scene.plan()
    assert [route.part for route in plan] == ["train"] * 6 + ["test"] * 4
    assert [route.number for route in plan] == list(range(10))
    assert all(b.first_frame - a.first_frame == 200 for a, b in pairwise(plan))
    assert len({(route.town, route.start) for route in plan}) == 10
    assert len({route.seed for route in plan}) == 10


def test_starts_lie_far_apart():
    points = [(x, y) for x in range(0, 100, 10) for y in range(0, 100, 10)]
    scene = CarlaScene()
    route = scene.plan()[0]
    taken = [points[starts(points, count, scene, route)] for count in range(1, 6)]
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
