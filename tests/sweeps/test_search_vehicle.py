"""The vehicle of a search goes along: into copies of its configuration, verification and clouds."""

import numpy as np
import pandas as pd
import pytest
import yaml

from lidarplace import PAPER_PLACEMENTS, Mount
from lidarplace.clouds.collect import collect
from lidarplace.clouds.own_body import check_mounts
from lidarplace.logs.box_log import read_box_log
from lidarplace.recall.detection_curve import default_curves
from lidarplace.recall.expected_recall import ExpectedRecall
from sweeps.configuration.file import public_yaml
from sweeps.configuration.grid import read_sweep
from sweeps.configuration.requirements_file import lay_out_requirements
from sweeps.plan.plan import make_plan
from sweeps.search.problem.assess import Traffic, assess
from sweeps.search.problem.problem import read_problem
from sweeps.search.problem.rig import MountedLidar, ordered, placement_of
from sweeps.search.verification.verify import read_verification
from tests.sweeps.search_files import run_search, write_search
from tests.sweeps.small_log import write_small_log
from tracking.run_folders.search import SearchFolder

LOW, HIGH = [-2.0, -0.9, 0.2], [2.0, 0.9, 2.3]
"""Of a vehicle that is higher than LiDARs of the paper are mounted."""
WALL = {"x": [-3.0, 60.0], "y": [1.0, 1.1], "z": [0.0, 6.0]}
NEAR = {"name": "somebody near", "where": {"distance": [3, 5]}, "what": "Pedestrian"}
NEAR |= {"at_least": {"points": 1}, "for": 0.2, "step": 1.0}
ROOF = {"roof": {"x": [-0.5, 0.5], "y": [-0.6, 0.6], "z": [2.4, 2.8]}}


@pytest.fixture
def mesh(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.box(bounds=[LOW, HIGH]).export(tmp_path / "body.stl")
    return {"mesh": "body.stl"}


@pytest.mark.parametrize("short", [False, True])
def test_a_copy_of_a_configuration_asks_the_same(tmp_path, monkeypatch, mesh, short):
    vehicle = mesh["mesh"] if short else mesh
    search = {"vehicle": vehicle, "zones": ROOF, "greedy": None}
    problem = read_problem(write_search(tmp_path, search=search))
    assert yaml.safe_load((tmp_path / "small.yaml").read_text())["search"]["vehicle"] == vehicle
    scene = {"source": "log", "folder": str(tmp_path / "log")}
    grid = {"scene": scene, "name": "grid", "placements": {"high": {"mounts": [{"z": 2.5}]}}}
    grid |= {"placement": "high", "classes": ["Car"]}
    grid |= {"grid": {"vehicle": [vehicle, [[LOW, HIGH]]]}}
    (tmp_path / "grid.yaml").write_text(yaml.safe_dump(grid))
    sweep = read_sweep(tmp_path / "grid.yaml")
    elsewhere = tmp_path / "runs" / "copied"
    elsewhere.mkdir(parents=True)
    for name, source in (("search", problem.source), ("grid", sweep.source)):
        (elsewhere / f"{name}.yaml").write_text(public_yaml(source))
    monkeypatch.chdir("/")
    assert read_problem(elsewhere / "search.yaml").key == problem.key
    plans = map(make_plan, (sweep, read_sweep(elsewhere / "grid.yaml")))
    first, again = ([task.key for task in plan.tasks] for plan in plans)
    assert first == again


def test_a_search_goes_on_from_its_run_folder(tmp_path, monkeypatch, mesh):
    search = {"vehicle": mesh, "zones": ROOF, "requirements": [NEAR], "greedy": None, "trials": 4}
    path = write_search(tmp_path, search=search, robustness=None)
    folder = tmp_path / "runs" / "small"
    run_search(path)
    before = pd.read_parquet(folder / "trials.parquet")
    monkeypatch.chdir("/")
    run_search(folder / "config.yaml", "--set", "search.trials=8")
    after = pd.read_parquet(folder / "trials.parquet")
    assert len(after) == 8
    pd.testing.assert_frame_equal(after.head(4)[before.columns], before)
    _compare_with_its_verification(folder, read_problem(folder / "config.yaml"))


def _compare_with_its_verification(folder, problem):
    """The sweep of a search asks the same requirements of the same rig, on the same vehicle."""
    sweep, plan = read_verification(problem)
    (results,) = plan.layouts
    assert results.requirement == problem.criteria.carrier.requirements[0].requirement
    np.testing.assert_array_equal(results.boxes, problem.criteria.carrier.requirements[0].boxes)
    for trial in plan.trials:
        check_mounts(trial.surrogates.stage.placement, trial.grid_point.vehicle)
        assert trial.requirements is not None
        assert len(trial.grid_point.vehicle.mesh.faces) == 12
    own = next(t for t in plan.trials if t.grid_point.point.placement == "found_1")
    rig = SearchFolder.read(folder).search.rigs["found_1"]
    assert own.requirements.stage.placement.mounts == rig.placed
    names = {t.grid_point.point.placement for t in plan.trials}
    (purpose,) = (
        c.what for c in SearchFolder.read(folder).search.commands if "sweep.yaml" in c.line
    )
    (plain,) = {name for name in names if not name.startswith("found_")}
    assert plain not in PAPER_PLACEMENTS, "their LiDARs are inside of this vehicle"
    assert purpose == f"train detectors for it and for {plain}"
    assert sweep.common.requirements == problem.file.search.requirements


def test_keep_outs_hide_what_is_behind_them_in_clouds_and_recall(tmp_path):
    """A wall on the left: nothing is seen of cars there, and those on the right are as before."""
    write_small_log(tmp_path / "log")
    log = read_box_log(tmp_path / "log")
    numbers, crop = log.frames["frame"].to_numpy(), (0.0, -20.0, 0.05, 40.0, 20.0, 4.0)
    rig = ordered([MountedLidar("lidar", "roof", Mount(0.2, 0.5, 2.0))])
    counts, points = [], []
    for keep_out in ({}, {"wall": WALL}):
        search = {"objective": "expected_recall.Car", "greedy": None, "keep_out": keep_out}
        lidar = {"beams": 16, "azimuth_steps": 1800}
        problem = read_problem(write_search(tmp_path, search=search, lidar=lidar))
        placement = placement_of(rig, problem.models)
        params = problem.pog_tasks(problem.sweep())[1].recall.stage
        model = ExpectedRecall.from_log(log, params.roi, ["Car"], vehicle=params.vehicle)
        counts.append(model.objects.seen_by([placement])[0].counts())
        judged = trial_of(problem, rig).collect_test[0].stage
        clouds = collect(log, numbers, placement, crop, vehicle=judged.vehicle)
        points.append(np.concatenate([clouds[i] for i in range(len(numbers))]))
    y = model.objects.table["y"].to_numpy()
    assert (counts[0][y > 2.5] > 0).any()
    assert (counts[1][y > 2.5] == 0).all()
    np.testing.assert_array_equal(counts[0][y < -1.0], counts[1][y < -1.0])
    assert (points[0][:, 1] > 2.5).any()
    assert not (points[1][:, 1] > 2.5).any()
    right = [cloud[cloud[:, 1] < -1.0] for cloud in points]
    np.testing.assert_array_equal(*right)


def trial_of(problem, rig):
    """As a generalist judges it, or a training does."""
    exact = {"detector": "pointpillars_tiny", "mounting_errors": {}}
    sweep = problem.sweep_of({"found": rig}, ["found"], exact)
    (trial,) = make_plan(sweep).trials
    return trial


def test_a_search_of_a_vehicle_that_bends(tmp_path):
    trailer = {"hitch": [-2, 0], "boxes": [[[-9, -0.9, 0.5], [-2.1, 0.9, 2.5]]]}
    vehicle = {"boxes": [[LOW, HIGH]], "trailer": trailer | {"angles_deg": [-80, 45]}}
    side = {"x": [-2.4, 1.5], "y": [1.2, 2.0], "z": 2.0}
    search = {"vehicle": vehicle, "zones": ROOF | {"side": side}, "keep_out": {"wall": WALL}}
    search |= {"requirements": [NEAR], "objective": "price", "greedy": None}
    path = write_search(tmp_path, search=search | {"constraints": {"body_share": 0.9}})
    problem = read_problem(path)
    bent = problem.criteria.carrier.vehicle
    assert list(bent.poses) == ["", "trailer at −80°", "trailer at 45°"]
    swept = problem.vehicle.vehicle()
    assert swept.body.angles == bent.body.angles
    layouts = lay_out_requirements(problem.file.search.requirements, swept, default_curves())
    np.testing.assert_array_equal(layouts[0].boxes, problem.criteria.carrier.requirements[0].boxes)
    assert swept.poses.keys() == bent.poses.keys()
    np.testing.assert_array_equal(swept.boxes, bent.boxes)
    roof = MountedLidar("lidar", "roof", Mount(0.0, 0.5, 2.5))
    behind = MountedLidar("lidar", "side", Mount(-2.3, 2.0, 2.0))
    assessment = assess(ordered([roof, behind]), problem.criteria, Traffic({}, None))
    assert assessment.violations["body"] > 0, "there is the trailer at -80 degrees"
    assert assess((roof,), problem.criteria, Traffic({}, None)).violations["body"] <= 0
    zones = {"on": {"x": [-8, -3], "y": 0, "z": [2.6, 2.7]}}
    above = write_search(tmp_path, search=search | {"zones": zones})
    lines = run_search(above, codes=(2,)).splitlines()
    assert lines == [f"{above}: search.zones.on: is inside the vehicle's body"]
