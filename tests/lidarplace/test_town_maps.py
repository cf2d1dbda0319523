"""Maps of towns: where they are found, what becomes of OpenDRIVE, and what is said of bad files."""

import gzip
import importlib.util
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from lidarplace.logs.boxes import POSE_COLUMNS
from lidarplace.scenes.sumo.maps import PACKAGE, build_network, find_carla_map
from lidarplace.scenes.sumo.record import record, record_town
from lidarplace.scenes.sumo.settings import SumoScene, TownRun
from tests.refused import refused

pytest.importorskip("sumolib")
from sumolib.net import readNet

MAPS = Path(__file__).parents[1] / "data" / "maps"
STREET, BLOCK = MAPS / "street.xodr", MAPS / "block.net.xml"

SHORT = {"routes": 2, "test_routes": 1, "frames_per_route": 10, "warmup_s": 2}
SMALL = SumoScene(towns=(str(STREET),), density=10, pedestrians=6, **SHORT)


@pytest.fixture
def no_maps(monkeypatch):
    """Neither the package nor CARLA is there."""
    monkeypatch.delenv("CARLA_ROOT", raising=False)
    monkeypatch.setattr("lidarplace.scenes.sumo.maps.find_spec", lambda name: None)


def test_a_carla_map_is_found_in_the_package_and_then_in_carla(monkeypatch, no_maps, tmp_path):
    folder = tmp_path / "site" / PACKAGE
    inside = folder / "parser" / "opendrive" / "carla_maps" / "Town03.xodr.gz"
    inside.parent.mkdir(parents=True)
    inside.touch()
    (folder / "__init__.py").write_text("raise ImportError('must not be imported')")
    maps = tmp_path / "carla" / "CarlaUE4" / "Content" / "Carla" / "Maps" / "OpenDrive"
    maps.mkdir(parents=True)
    for name in ("Town03", "Town05"):
        (maps / f"{name}.xodr").touch()
    monkeypatch.setenv("CARLA_ROOT", str(tmp_path / "carla"))
    assert find_carla_map("Town03") == maps / "Town03.xodr"
    monkeypatch.setattr("lidarplace.scenes.sumo.maps.find_spec", importlib.util.find_spec)
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    monkeypatch.delitem(importlib.import_module("sys").modules, PACKAGE, raising=False)
    assert find_carla_map("Town03") == inside
    assert find_carla_map("Town05") == maps / "Town05.xodr"
    with refused(f"'Town99' in {inside.parent} and {maps}"):
        find_carla_map("Town99")


def test_a_missing_carla_map_says_how_to_get_it(no_maps):
    with refused(r"'Town03' in the package py123d \(not in.*; .*pip install --no-deps py123d"):
        record(SMALL.model_copy(update={"towns": ("Town03",)}))
    with refused("CC-BY 4.0.*CARLA_ROOT"):
        find_carla_map("Town03")


def network_of(path, folder):
    town = build_network(str(path), 0, folder)
    return readNet(str(town.path), withInternal=True, withPedestrianConnections=True)


@pytest.fixture(scope="module")
def street(tmp_path_factory):
    return network_of(STREET, tmp_path_factory.mktemp("street"))


def test_opendrive_lanes_and_coordinates(street):
    lanes = [lane for edge in street.getEdges(withInternal=False) for lane in edge.getLanes()]
    who = [[c for c in ("passenger", "bicycle", "pedestrian") if lane.allows(c)] for lane in lanes]
    assert who == [["pedestrian"], [], ["passenger", "bicycle"]] * 2
    right = [lane.getShape3D()[0] for lane in lanes if lane.getEdge().getID() == "-1"]
    # The middle of the right lanes at the start of the road, which is at (-100, 5, 2).
    np.testing.assert_allclose(right, [(-100, 0, 2), (-100, 1.25, 2), (-100, 3.25, 2)], atol=0.01)


def test_a_street_with_two_dead_ends_is_driven_for_ever(tmp_path, monkeypatch):
    shutil.copy(STREET, tmp_path)
    monkeypatch.chdir(tmp_path)
    log = record(SMALL.model_copy(update={"towns": ("street.xodr",)}))
    assert os.listdir(tmp_path) == ["street.xodr"], "the working folder stays clean"
    assert len(log.frames) == 30
    assert set(log.boxes["class"]) == {"Car", "Cyclist", "Pedestrian"}
    names = ["sumo-0-train-street", "sumo-0-test-street"]
    assert log.frames["scene"].unique().tolist() == names
    y = log.frames["ego_y"][log.frames["ego_x"] < -10]
    assert (y - 5).abs().between(0.5, 3.5).all()
    train, test = (log.buildings[log.buildings["scene"] == name] for name in names)
    both = train.merge(test, on=["x", "y", "height"])
    assert len(both) > 5  # the town is the same in training and testing


def test_a_packed_map_whose_centre_lane_has_no_type_makes_no_difference(street, tmp_path):
    """As in OpenDRIVE 1.8; sidewalks are called walking there."""
    text = STREET.read_text().replace('<lane id="0" type="none"', '<lane id="0"')
    path = tmp_path / "street.xodr.gz"
    path.write_bytes(gzip.compress(text.replace('"sidewalk"', '"walking"').encode()))
    network = network_of(path, tmp_path)
    for old, new in zip(street.getEdges(), network.getEdges(), strict=True):
        for a, b in zip(old.getLanes(), new.getLanes(), strict=True):
            assert a.getShape3D() == b.getShape3D()
            assert a.getPermissions() == b.getPermissions()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('type="driving"', 'type="exit"'),
        ('type="driving"', 'type="offRamp"'),
        ('type="driving"', 'type="slipLane"'),
        ('type="shoulder"', 'type="roadWorks"'),
        ("<line/>", '<arc curvature="0.0"/>'),
        ("</lanes>", '</lanes><signals><signal s="0" t="3" id="1" type=""/></signals>'),
    ],
)
def test_what_netconvert_would_drop_makes_no_difference(street, tmp_path, old, new):
    text = STREET.read_text()
    assert old in text
    (tmp_path / "street.xodr").write_text(text.replace(old, new))
    network = network_of(tmp_path / "street.xodr", tmp_path)
    for a, b in zip(street.getEdges(), network.getEdges(), strict=True):
        assert [(each.getPermissions(), each.getShape()) for each in a.getLanes()] == [
            (each.getPermissions(), each.getShape()) for each in b.getLanes()
        ]


def test_a_sumo_network_needs_no_pedestrians():
    scene = SMALL.model_copy(update={"towns": (str(BLOCK),), "pedestrians": 0})
    log = record(scene)
    assert set(log.boxes["class"]) == {"Car", "Cyclist"}
    # Nobody is in the street without a way back.
    assert log.frames["ego_x"].max() < 130
    with refused((str(BLOCK), "pedestrians", "6")):
        record(scene.model_copy(update={"pedestrians": 6}))


def test_runs_are_numbered_before_anything_is_recorded():
    both = ("generated", str(STREET))
    towns = {"towns": (*both, "generated"), "test_towns": both}
    scene = SMALL.model_copy(update=towns | {"routes": 5, "egos_per_run": 2, "test_routes": 2})
    runs = scene.town_runs()
    assert [run.routes for run in runs] == [2, 2, 1] * 3 + [2, 2]
    assert [run.first_route for run in runs] == [0, 2, 4, 5, 7, 9, 10, 12, 14, 15, 17]
    assert [run.first_frame for run in runs] == [10 * run.first_route for run in runs]
    assert len({run.name for run in runs}) == len({run.traffic_seed for run in runs}) == len(runs)
    assert runs[1].name == "sumo-0-train-generated/2"
    assert runs[3].name == "sumo-0-train-street"
    generated = [run.town_seed for run in runs if run.town == "generated"]
    assert len(set(generated)) == 3
    assert len({run.town_seed for run in runs if run.town == str(STREET)}) == 1
    assert scene.frame_counts() == (150, 40)
    assert scene.model_copy(update={"split": "paper"}).frame_counts() == (171, 19)


def test_a_run_is_recorded_on_its_own_from_json():
    scene = SMALL.model_copy(update={"egos_per_run": 1})
    whole = record(scene)
    run = TownRun.model_validate_json(scene.town_runs()[1].model_dump_json())
    part = record_town(scene, run)
    assert part.frames["route"].unique().tolist() == [1]
    for table in ("boxes", "frames", "buildings"):
        mine = getattr(whole, table)
        mine = mine[mine["scene"] == run.name].reset_index(drop=True)
        assert mine.equals(getattr(part, table))
    first, second = (whole.frames[whole.frames["route"] == route] for route in (0, 1))
    assert not np.isin(first[[*POSE_COLUMNS]], second[[*POSE_COLUMNS]]).any()


@pytest.mark.skipif(importlib.util.find_spec(PACKAGE) is None, reason="no maps of CARLA here")
def test_a_carla_town_without_sidewalks_gets_some(monkeypatch):
    monkeypatch.delenv("CARLA_ROOT", raising=False)
    scene = SumoScene(
        towns=("Town06",), density=120, pedestrians=60, routes=2, test_routes=0, frames_per_route=2
    )
    log = record(scene.model_copy(update={"warmup_s": 2.0}))
    assert {"Car", "Cyclist"} <= set(log.boxes["class"])
    assert len(log.buildings) > 0
