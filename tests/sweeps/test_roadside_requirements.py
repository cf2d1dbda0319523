"""Requirements of poles: among the buildings and lanes of their site, and no vehicle."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from lidarplace import Lidar, Mount, Placement
from lidarplace.logs.box_log import write_box_log
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.requirements.area import Area
from lidarplace.requirements.check_requirements import check_requirements
from lidarplace.requirements.layout import lay_out
from lidarplace.requirements.requirement import PlacedObject, Requirement
from lidarplace.scenes.site import Obstacles, Poles
from sweeps.commands.requirements import app
from sweeps.configuration.requirements_file import read_requirements_check
from sweeps.plan.plan import read_plan
from sweeps.search.problem.problem import read_problem
from tests.lidarplace.driven_past import POSES, driven_past
from tests.refused import refused
from tests.sweeps.small_log import SMALL, TOWN
from tests.sweeps.toy import call

POLE = {"mounts": [{"x": 8, "y": 12, "z": 6}]}
WANTED = {"name": "people", "where": {"x": [-20, 20], "y": [-20, 20]}, "what": "Pedestrian"}
WANTED |= {"at_least": {"points": 1}, "step": 4.0}
FILE = {"site": {}, "scene": TOWN, "lidar": {"azimuth_steps": 360}, "requirements": [WANTED]}


def write(path, **keys):
    whole = FILE | {"placements": {"pole": POLE}} | keys
    content = {key: value for key, value in whole.items() if value is not None}
    (path / "needs.yaml").write_text(yaml.safe_dump(content))
    return path / "needs.yaml"


@pytest.mark.parametrize(("measure", "least"), [("points", 1e9), ("coverage", 1.0)])
def test_a_building_hides_as_the_boxes_of_a_body_do(measure, least):
    """By its surface, turned by a quarter, and by an upright box, which is cast otherwise."""
    lidar = Lidar(tuple(np.radians(np.arange(-60.0, 3.0, 3.0))), azimuth_steps=360)
    rig = Placement("pole", [Mount(x=1.0, y=0.5, z=5.0)], lidar)
    walls = np.array([[6.0, 0.0, 3.0, 8.0, 4.0, 6.0, math.pi / 2]])
    poles = Poles("site", (), around=Obstacles(walls, np.empty((0, 5)))).with_walls
    box = Vehicle("box", np.array([[[4.0, -4.0, 0.0], [8.0, 4.0, 6.0]]]))
    area, person = Area((0.0, 20.0), ((-6.0, 6.0),)), PlacedObject(0.5, 0.5, 1.7)
    kind = {"heights": (0.0, 2.0)} if measure == "coverage" else {}
    placed = person if measure == "points" else None
    wanted = Requirement("x", area, measure, least, placed, step=0.5, **kind)
    layouts = [lay_out(wanted, vehicle) for vehicle in (poles, box)]
    one, other = (check_requirements([layout], rig, layout.vehicle)[0] for layout in layouts)
    np.testing.assert_array_equal(one.positions.held, other.positions.held)
    np.testing.assert_allclose(one.least_of, other.least_of, equal_nan=True)
    free = check_requirements([lay_out(wanted, replace(poles, mesh=None))], rig, Vehicle("-", ()))
    assert (one.least_of == 0).sum() > (free[0].least_of == 0).sum()


def test_a_page_of_poles_names_no_vehicle(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = call(app, write(tmp_path), "--json", code=1)
    (outcome,) = json.loads(done.stdout)["outcomes"]
    assert outcome["rig"] == "pole"
    page = Path("requirements.html").read_text()
    words = page[page.index("<body") :].partition('<script type="application/json"')[0]
    assert "LiDARs on poles" in page
    assert "Only buildings and keep-outs occlude it" in words
    assert "grey lines are the poles, lanes and buildings" in words
    assert "vehicle" not in words


def test_a_search_writes_files_that_are_accepted(tmp_path):
    """A rig with the keys of its search is checked at the site of the search, and so is a sweep."""
    zone = {"polygon": [[7, 11], [9, 11], [9, 13], [7, 13]], "z": [5, 8]}
    search = {"lidars": 1, "zones": {"kerb": zone}, "objective": "covered_entropy", "trials": 4}
    keys = SMALL | {"site": {}, "scene": TOWN, "robustness": None, "output": str(tmp_path)}
    path = tmp_path / "search.yaml"
    path.write_text(yaml.safe_dump(keys | {"search": search | {"requirements": [WANTED]}}))
    problem = read_problem(path)
    (tmp_path / "placement.yaml").write_text(yaml.safe_dump({**problem.source, **POLE}))
    check = read_requirements_check(tmp_path / "placement.yaml")
    in_file = read_requirements_check(write(tmp_path, placements=None, rigs=[str(tmp_path)]))
    del keys["robustness"]
    sweep = keys | {"placements": {"pole": POLE}, "placement": "pole", "requirements": [WANTED]}
    (tmp_path / "sweep.yaml").write_text(yaml.safe_dump(sweep | {"detector": None}))
    _, plan = read_plan(tmp_path / "sweep.yaml")
    layouts = (*check.layouts, *in_file.layouts, *problem.criteria.carrier.requirements)
    boxes = [layout.boxes for layout in (*layouts, *plan.layouts)]
    assert len(boxes) == 4
    assert all(np.array_equal(each, boxes[0], equal_nan=True) for each in boxes)
    assert len(boxes[0][0]) < 11 * 11, "none is within a building"


def at_log(path, **site):
    write_box_log(path / "log", driven_past(POSES))
    return {"scene": {"source": "log", "folder": str(path / "log")}, "site": site}


def test_a_log_without_buildings_hides_nothing(tmp_path):
    check = read_requirements_check(write(tmp_path, **at_log(tmp_path, x=30.0, y=0.0)))
    assert check.layouts[0].positions.held.all()
    assert check.layouts[0].vehicle.mesh is None


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({"vehicle": [[[-2, -1, 0], [2, 1, 1]]]}, ("needs.yaml", "site", "")),
        ({"site": None}, ("needs.yaml", "scene", "")),
        ({"site": {"x": 9000.0, "y": 0.0}}, ("needs.yaml", "site", "")),
        ({"placements": {"pole": {"mounts": [{"z": 3}]}}}, "rigs.*pole.*way of vehicles"),
        ({"placements": {"pole": {"mounts": [{"x": 8, "y": 12, "z": 16}]}}}, "expected 0.* 15"),
        ({"requirements": [WANTED | {"where": {"distance": [0, 5]}}]}, "where.distance.*body"),
        ({"requirements": "un_r158"}, "needs.yaml.*body"),
    ],
)
def test_a_file_of_poles_that_cannot_be_is_one_line(tmp_path, keys, expected):
    with refused(expected):
        read_requirements_check(write(tmp_path, **keys))


def test_a_site_of_a_log_needs_its_place(tmp_path):
    with refused(("needs.yaml", "site.x", "")):
        read_requirements_check(write(tmp_path, **at_log(tmp_path)))
