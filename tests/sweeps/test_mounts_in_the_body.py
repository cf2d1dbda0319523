"""A LiDAR inside of the vehicle, or that sees nothing of the ROI, is refused, and the vehicle of a
file is that of its clouds."""

import re

import numpy as np
import pytest

from lidarplace import PAPER_PLACEMENTS, Mount, Placement
from lidarplace.clouds.own_body import check_mounts
from lidarplace.mounting.vehicle import Vehicle
from sweeps.commands.run import app
from sweeps.configuration.grid import read_sweep
from sweeps.plan.plan import make_plan
from sweeps.search.greedy.candidates import candidates_of
from sweeps.search.problem.assess import Traffic, assess
from sweeps.search.problem.constraints import measures_of
from sweeps.search.problem.problem import read_problem
from sweeps.search.problem.rig import MountedLidar
from sweeps.stages.task import plain
from tests.refused import refused
from tests.sweeps.search_files import write_search
from tests.sweeps.small_log import write_sweep
from tests.sweeps.toy import call

NOSE = {"x": 2.25, "z": 0.6}
TRUCK = [[[-4.0, -1.2, 0.3], [4.0, 1.2, 3.0]]]


def sweep_file(folder, **changes):
    base = {"placements": {"nose": {"mounts": [{"z": 2.0}, NOSE]}}, "placement": "nose"}
    return write_sweep(folder, **base | changes)


@pytest.mark.parametrize(
    ("mount", "vehicle", "held"),
    [
        ({"x": 2.0, "z": 0.5}, None, True),
        ({"x": 2.25, "z": 0.6}, None, False),  # before the bonnet's slope, at 2.189 there
        ({"x": 2.18, "z": 0.6}, None, True),
        ({"x": 2.25, "z": 0.22}, None, True),
        ({"z": 1.499}, None, True),
        ({"z": 1.5}, None, False),
        ({"z": 2.0}, TRUCK, True),
        ({"z": 3.0}, TRUCK, False),
        ({"z": 3.001}, TRUCK, False),
        ({"z": 2.999}, TRUCK, True),
        ({"x": 4.0, "z": 1.0}, TRUCK, False),
        ({"x": 2.0, "z": 0.5}, [], False),
    ],
)
def test_of_a_sweep(tmp_path, mount, vehicle, held):
    rigs = {"mine": {"mounts": [{"z": 5.0}, mount]}}
    path = sweep_file(tmp_path, placements=rigs, placement="mine", vehicle=vehicle)
    if not held:
        read_sweep(path, ["allow_blind_lidars=true"])  # of a roof as wide as the truck's
        return
    at = ", ".join(f"{mount.get(axis, 0):g}" for axis in "xyz")
    with refused((str(path), "placement", ""), f"'mine': LiDAR 2 at ({at}) "):
        read_sweep(path)


def test_an_axis_of_vehicles_names_the_one_in_which_it_is(tmp_path):
    path = sweep_file(tmp_path, grid={"vehicle": [None, [], TRUCK]})
    with refused((str(path), "placement", ""), "'nose': LiDAR 1 at (0, 0, 2) "):
        read_sweep(path)
    assert len(read_sweep(sweep_file(tmp_path, grid={"vehicle": [None, []]})).points) == 2


def test_recorded_clouds_and_the_paper_s_rigs_of_a_search_are_not_asked(tmp_path):
    problem = read_problem(write_search(tmp_path, search={"vehicle": TRUCK, "zones": high()}))
    settings = problem.verify_settings({}, ["line"])
    assert settings["vehicle"] == {"boxes": TRUCK}
    low = {"mounts": [{"x": 2.0, "z": 0.5}]}
    scene = {"source": "log", "folder": str(tmp_path / "log"), "clouds": "recorded"}
    read_sweep(sweep_file(tmp_path, scene=scene, placements={"low": low}, placement="low"))


def high():
    return {"roof": {"x": [-0.5, 0.5], "y": [-0.6, 0.6], "z": [3.1, 3.3]}}


def test_clouds_and_expected_recall_have_the_vehicle_and_their_keys_know_it(tmp_path):
    def keys(**changes):
        plan = make_plan(read_sweep(sweep_file(tmp_path, **changes)))
        return {task.stage.name: task.key for task in plan.tasks}

    sedan, none = keys(), keys(vehicle=[])
    for stage in ("collect", "recall", "finetune", "evaluate"):
        assert sedan[stage] != none[stage]
    for stage in ("pog", "surrogates", "ground_truth"):
        assert sedan[stage] == none[stage]
    assert keys(vehicle=TRUCK[:0]) == none
    other = [[[-4.0, -1.2, 0.301], [4.0, 1.2, 3.0]]]
    tall = {"placements": {"nose": {"mounts": [{"z": 3.2}]}}}
    assert keys(vehicle=TRUCK, **tall)["collect"] != keys(vehicle=other, **tall)["collect"]
    assert plain(np.zeros(3)) != plain(np.zeros((3, 1)))


SKY = {"z": 2.6, "lidar": "bpearl"}
SEES_NOTHING = r"LiDAR 1 at \(0, 0, 2\.6\) sees no ground and nothing below 2 m in the ROI \(x \[0"


def test_a_sweep_with_a_blind_lidar_is_refused(tmp_path):
    def path(mount=SKY, **changes):
        return sweep_file(tmp_path, placements={"sky": {"mounts": [mount]}}, **changes)

    sky = {"placement": "sky", "detector": None}
    for arguments in (["--dry-run"], []):
        (line,) = call(app, path(**sky), *arguments, code=2).stderr.splitlines()
        assert re.search(f"placement: 'sky': {SEES_NOTHING}", line)
        assert line.endswith("or set allow_blind_lidars: true")
    read_sweep(path(**sky, allow_blind_lidars=True))
    dead = {"sky": {"mounts": [{"z": 2.0}], "dead": [SKY]}}
    read_sweep(sweep_file(tmp_path, **sky | {"placements": dead}))
    recorded = {"source": "log", "folder": str(tmp_path / "log"), "clouds": "recorded"}
    read_sweep(path(**sky | {"scene": recorded}))
    back = {"x": -2.5, "z": 1.0, "yaw_deg": 180, "lidar": "at128"}
    around = {"x": [-40, 40], "y": [-20, 20], "z": [0, 4]}
    read_sweep(path(back, **sky, roi=around))
    with refused(("", "placement", ""), "extend the ROI"):
        read_sweep(path(back, **sky, grid={"roi": [around, around | {"x": [0, 40]}]}))


def test_blind_lidars_of_a_search(tmp_path):
    """A fixed one is refused; what is searched for is infeasible."""

    def problem(allow=False, **search):
        path = write_search(tmp_path, lidar="bpearl", search=search)
        return read_problem(path, [f"allow_blind_lidars={str(allow).lower()}"])

    def found(problem, *turns):
        rig = [
            MountedLidar("lidar", "roof", Mount(y=i, z=2.6, roll=t)) for i, t in enumerate(turns)
        ]
        return assess(tuple(rig), problem.criteria, Traffic({}, None))

    searched = problem(objective="price", models={"lidar_1": {"name": "bpearl", "price": 1}})
    violations = [found(searched, *turns).violations for turns in ((0, 0), (0, 1.6), (1.6, -1.6))]
    assert [item["blind_lidars"] for item in violations] == [2, 1, 0]
    assert [found(searched, 1.6, turn).feasible for turn in (0, 1.6)] == [False, True]
    roof = {"zones": {"roof": {"x": 0, "y": [-0.5, 0.5], "z": 2.6}}, "roll_deg": 0}
    assert candidates_of(problem(**roof)) == []
    assert candidates_of(problem(allow=True, **roof))
    fixed = {"fixed": [{"z": 2.6}]}
    names = {item.name for item in problem(allow=True, **fixed).criteria.constraints}
    assert "blind_lidars" not in names
    assert problem().key != problem(allow=True).key


def test_of_a_search(tmp_path):
    def problem(**search):
        return read_problem(write_search(tmp_path, search=search))

    assert "body" not in {constraint.name for constraint in problem().criteria.constraints}
    into = {"front": {"x": [2.2, 2.6], "y": [-0.5, 0.5], "z": 0.5}}
    found = problem(zones=into, lidars=1, greedy={"position_step": 0.1})
    (body,) = [constraint for constraint in found.criteria.constraints if constraint.name == "body"]

    def violation(x):
        rig = (MountedLidar("lidar", "front", Mount(x=x, z=0.5)),)
        return body.violation(measures_of(rig, [body], found.criteria.carrier)["body"])

    assert violation(2.25) == pytest.approx(0.1)
    assert violation(2.35) == violation(2.6) == 0
    offered = [rig[0].mount.x for rig in candidates_of(found)]
    assert min(offered) == pytest.approx(2.4)


def test_a_mirrored_zone_reaches_into_what_is_on_the_other_side(tmp_path):
    right = [[[-1.0, -1.5, 0.0], [1.0, -0.5, 2.0]]]
    zone = {"x": 0, "y": [0.8, 1.2], "z": [1.0, 1.5]}
    pairs = {"lidars": [0, 1], "mirrored": True}
    for symmetric, keys, reaches in ((False, {}, False), (True, {}, True), (False, pairs, True)):
        search = {"vehicle": right, "zones": {"side": zone | keys}, "symmetric": symmetric}
        criteria = read_problem(write_search(tmp_path, search=search)).criteria
        assert ("body" in {constraint.name for constraint in criteria.constraints}) == reaches


def test_a_search_of_objects_has_its_vehicle(tmp_path):
    search = {"vehicle": TRUCK, "zones": high(), "objective": "expected_recall.Car"}
    problem = read_problem(write_search(tmp_path, search=search))
    _, trial = problem.pog_tasks(problem.sweep())
    np.testing.assert_array_equal(trial.recall.stage.vehicle.boxes, TRUCK)
    plain_car = read_problem(write_search(tmp_path, search=search | {"vehicle": None}))
    _, trial = plain_car.pog_tasks(plain_car.sweep())
    assert trial.recall.stage.vehicle is None
    assert Vehicle.car().height == plain_car.criteria.carrier.vehicle.height


def test_the_paper_s_rigs_are_above_the_car():
    for rig in PAPER_PLACEMENTS.values():
        check_mounts(rig, None)
        check_mounts(rig, Vehicle.car())
    with refused(("'low'", "", "")):
        check_mounts(Placement("low", [Mount(z=0.5)], PAPER_PLACEMENTS["line"].lidars[0]), None)
