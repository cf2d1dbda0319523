"""The studio of a site: poles in no wall and no lane, zones along kerbs, and sweeps of them."""

import pytest
from typer.testing import CliRunner

from lidarplace.studio.log_frames import scene_of, traffic_at
from lidarplace.studio.rigs_file import read_rigs
from lidarplace.studio.studio import Studio
from sweeps.command_line import app
from sweeps.plan.plan import read_plan
from tests.lidarplace.studio.rigs import ROI, written
from tests.refused import refused
from tests.sweeps.small_log import TOWN

POLE = {"x": 10.3, "y": 10, "z": 6}
KERBS = {"kerb": [0.5, 2.5], "x": [-16, 16], "y": [-16, 16], "z": [5, 8]}
FILE = {
    "site": {},
    "scene": TOWN,
    "lidar": "vlp16",
    "zones": {"kerbs": KERBS},
    "placements": {"pole": {"mounts": [POLE]}},
}


@pytest.fixture(scope="module")
def studio(tmp_path_factory):
    file = read_rigs(written(tmp_path_factory.mktemp("poles"), FILE))
    return Studio(file, traffic_at(file.scene, file.site, 4), ROI)


def test_a_pole_is_checked_against_walls_and_lanes(studio):
    assert len(studio.log.frames) == 4
    assert not len(studio.file.carrier.extents)
    assert not studio.violations()
    wall = studio.file.around.buildings[0]
    for (x, y, z), expected in {
        (0.0, 0.0, 3.0): "LiDAR 1 at .* in the way of vehicles",
        (*wall[:2], 2.0): "LiDAR 1 at .* inside of a building",
        (8.0, 12.2, 16.0): "LiDAR 1: z: expected .* 15",
    }.items():
        studio.pose(0, x=float(x), y=float(y), z=z)
        (violation,) = (each for each in studio.violations() if each.limit == "pole")
        with refused(expected):
            raise ValueError(violation.text)
        with refused(expected):
            studio.sweep(studio.file.path.with_name("not.yaml"), scene_of(None))
    while studio.undo():
        pass


def test_one_more_pole_is_found_along_the_kerbs(studio):
    studio.add_best()
    *_, mount = studio.rig.mounts
    assert not studio.file.blocked(1, mount.position)
    assert not [each for each in studio.violations() if each.limit == "zone"]
    studio.undo()


def test_a_sweep_and_a_saved_file_have_the_site(studio, tmp_path):
    scene = scene_of(None, studio.file.scene)
    studio.sweep(tmp_path / "sweep.yaml", scene)
    sweep, _ = read_plan(tmp_path / "sweep.yaml")
    assert "vehicle" not in sweep.source
    (point,) = sweep.points
    assert point.point.site is not None
    assert point.point.scene == studio.file.scene
    assert not len(point.vehicle.extents)
    studio.pose(0, x=10.5)
    saved = read_rigs(studio.save(tmp_path / "saved.yaml"))
    studio.undo()
    assert saved.content | {"placements": 0} == FILE | {"placements": 0}
    assert saved.rigs[0].mounts[0].x == 10.5
    assert saved.zones == studio.file.zones


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({"vehicle": [[[-2, -1, 0], [2, 1, 1]]]}, "rigs.yaml: site: a site has no vehicle"),
        ({"site": None}, "rigs.yaml: scene: is of a site"),
        ({"site": None, "scene": None}, "rigs.yaml: zones.kerbs.kerb: only a site has kerbs"),
        ({"zones": {"k": {"kerb": 1, "z": 5}}}, "rigs.yaml: zones.k.x: missing"),
        ({"zones": {"k": KERBS, "k_1": {"x": 0, "y": 0, "z": 5}}}, "zones.k_1: the name of a str"),
        ({"scene": {"density": -1}}, "rigs.yaml: scene.density: expected"),
        ({"scene": {"source": "log", "folder": "none"}}, "rigs.yaml: scene.folder: none/"),
    ],
)
def test_a_file_that_cannot_be_is_one_line(tmp_path, keys, expected):
    with refused(expected):
        read_rigs(written(tmp_path, FILE | keys))


def test_a_site_names_its_traffic_in_the_file(tmp_path):
    path = written(tmp_path, FILE)
    outcome = CliRunner().invoke(app, ["studio", str(path), "--log", "logs/mine"])
    assert outcome.exit_code == 2
    assert "--log: the file has a site; set scene: " in outcome.stderr
