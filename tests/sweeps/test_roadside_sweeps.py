"""Sweeps and searches of a site: no vehicle, frames near to it, poles in no wall and no lane."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import yaml

from lidarplace import Mount
from lidarplace.configuration.answer import as_requirements, studio_content
from lidarplace.logs.box_log import join_logs, write_box_log
from lidarplace.scenes.kinds import obstacles_around
from lidarplace.scenes.site import Site
from lidarplace.studio.rigs_file import read_rigs
from sweeps.configuration.grid import read_sweep
from sweeps.plan.plan import read_plan
from sweeps.results.rigs import rigs_yaml
from sweeps.search.problem.problem import read_problem
from sweeps.search.problem.rig import MountedLidar
from tests.lidarplace.driven_past import driven_past
from tests.refused import refused
from tests.sweeps.small_log import SMALL, TOWN
from tests.sweeps.toy import ran
from tracking.run_folders.sweep_json import SweepResult
from tracking.run_folders.sweep_tables import REQUIREMENTS, SURROGATES

POSES = [(x, 2.0, 0.0, 0.0, 0.0, 0.1) for x in (-60.0, 5.0, 15.0, 25.0, 35.0, 45.0)]
POLE = {"mounts": [{"x": 8, "y": 12, "z": 6}]}
BODY = [[[-2, -1, 0], [2, 1, 1]]]
KERB = {"polygon": [[7, 11], [9, 11], [9, 13], [7, 13]], "z": [5, 8]}


def write(path, **keys):
    at_town = {"site": {}, "scene": TOWN, "detector": None, "output": str(path / "runs")}
    grid = {"placements": {"pole": POLE}, "placement": "pole"}
    (path / "grid.yaml").write_text(yaml.safe_dump(SMALL | at_town | grid | keys))
    return path / "grid.yaml"


def write_log(folder, poses=POSES):
    """Half of the frames train, half test."""
    log = driven_past(poses)
    split = ["train" if frame % 2 == 0 else "test" for frame in log.frames["frame"]]
    write_box_log(folder, replace(log, frames=log.frames.assign(split=split)))
    return {"source": "log", "folder": str(folder)}


def scores(path) -> pd.DataFrame:
    """Surrogates of a sweep, whose tasks are run one after the other."""
    _, plan = read_plan(path)
    results = {}
    for task in plan.tasks:
        results[task.key] = task.stage.run(*(results[one.key] for one in task.inputs))
    tables = [results[task.key].table for trial in plan.trials for task in trial.scores]
    return pd.concat(tables)[["class", "surrogate", "value"]].reset_index(drop=True)


def test_a_log_is_seen_from_a_site(tmp_path):
    scene = write_log(tmp_path / "log")
    site = {"x": 30.0, "y": 0.0}
    sweep, plan = read_plan(write(tmp_path, scene=scene, site=site))
    (point,) = sweep.points
    assert point.point.frame_counts() == (2, 3)
    (tmp_path / "log" / "frames.parquet").rename(tmp_path / "frames.parquet")
    assert point.point.frame_counts() == (2, 3)  # the table is read once
    (tmp_path / "frames.parquet").rename(tmp_path / "log" / "frames.parquet")
    assert any("1 of 6 frames are left out" in caution for caution in plan.cautions)
    assert not len(point.vehicle.extents)
    values = scores(tmp_path / "grid.yaml").set_index("surrogate")["value"]
    assert values["covered_entropy"] > 0
    with refused("no train frame has the recording vehicle within 30 m"):
        read_sweep(write(tmp_path, scene=scene, site={"x": 30.0, "y": 500.0}))
    with refused("recorded clouds are of the vehicle"):
        read_plan(write(tmp_path, scene=scene | {"clouds": "recorded"}, site=site))


def test_run_folders_have_what_is_around_a_site(tmp_path):
    names = {"resolution": 0.8, "accuracy": False, "sampling_error": False}
    surrogate = {"names": ["covered_entropy"]} | names
    sweep = read_sweep(write(tmp_path, surrogate=surrogate, vehicle={"keep_out": BODY}))
    folder = ran(sweep, tmp_path)[-1]
    assert yaml.safe_load((folder / "rigs.yaml").read_text())["vehicle"] == {"keep_out": BODY}
    around = SweepResult.read(folder).body.around
    whole = obstacles_around(sweep.points[0].point.scene, Site())
    assert 0 < len(around.buildings) < len(whole.buildings)
    assert 0 < len(around.lanes) < len(whole.lanes)
    assert np.hypot(*around.buildings[:, :2].T).max() < 80


def test_rows_of_sites_and_towns_that_differ_are_told_apart(tmp_path):
    near = {"name": "near", "where": {"x": [3, 5], "y": [-1, 1]}, "what": "Car", "step": 1.0}
    names = {"names": ["covered_entropy"], "accuracy": False, "sampling_error": False}
    keys = {"surrogate": {"resolution": 0.8} | names}
    keys["placements"] = {"gantry": {"mounts": [{"z": 7}]}}
    keys |= {"placement": "gantry", "grid": {"site.yaw_deg": [0, 90]}}
    path = write(tmp_path, requirements=[near | {"at_least": {"points": 1}}], **keys)
    folder = ran(read_sweep(path), tmp_path)[-1]
    for table in (SURROGATES, REQUIREMENTS):
        rows = pd.read_parquet(folder / table.file)
        assert set(rows["site.yaw_deg"]) == {0, 90}
        assert table.axes_of(["scene.seed"]), "buildings of a town hide objects"


def test_a_site_is_the_sweep_of_a_standing_vehicle_without_a_body(tmp_path):
    """To the last bit, with the log of the site as that of the vehicle."""
    site, standing = (tmp_path / name for name in ("site", "standing"))
    for folder in (site, standing):
        folder.mkdir()
    names = {"resolution": 0.8, "accuracy": False, "sampling_error": False}
    surrogate = {"surrogate": names | {"names": ["s_mig", "expected_points", "expected_recall"]}}
    _, plan = read_plan(write(site, **surrogate))
    values = scores(site / "grid.yaml")
    logs = [task.stage.run() for task in plan.tasks if task.stage.name == "scene"]
    write_box_log(standing / "log", join_logs(logs))
    scene = {"source": "log", "folder": str(standing / "log"), "seed": TOWN["seed"]}
    again = scores(write(standing, scene=scene, site=None, vehicle=[], **surrogate))
    pd.testing.assert_frame_equal(values, again, check_exact=True)
    assert (values["value"] != 0).all()


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({"vehicle": BODY}, ("grid.yaml", "site", "")),
        ({"site": {"x": 5.0}}, ("grid.yaml", "site.y", "")),
        ({"site": {"x": 9000.0, "y": 0.0}}, ("grid.yaml", "site", "")),
        ({"scene": TOWN | {"min_travel_m": 1.0}}, ("grid.yaml", "scene.min_travel_m", "1")),
        ({"placements": {"pole": {"mounts": [{"x": 8, "y": 12, "z": 16}]}}}, "expected 0.* 15"),
        ({"placements": {"pole": {"mounts": [{"x": 0, "y": 0, "z": 3}]}}}, "way of vehicles"),
    ],
)
def test_a_site_that_cannot_be_is_one_line(tmp_path, keys, expected):
    with refused(expected):
        read_sweep(write(tmp_path, **keys))


def test_a_vehicle_without_a_body_may_be_named(tmp_path):
    sweep = read_sweep(write(tmp_path, vehicle=[]))
    assert not len(sweep.points[0].vehicle.extents)
    (tmp_path / "rigs.yaml").write_text(rigs_yaml(sweep))
    file = read_rigs(tmp_path / "rigs.yaml")
    assert (file.site, file.scene) == (sweep.points[0].point.site, sweep.points[0].point.scene)


def search(path, **settings):
    own = {"lidars": 1, "zones": {"kerb": KERB}, "objective": "covered_entropy", "trials": 4}
    keys = SMALL | {"site": {}, "scene": TOWN, "output": str(path / "runs"), "robustness": None}
    (path / "search.yaml").write_text(yaml.safe_dump(keys | {"search": own | settings}))
    return path / "search.yaml"


def test_a_search_of_poles_has_no_vehicle(tmp_path):
    problem = read_problem(search(tmp_path))
    assert not len(problem.criteria.carrier.vehicle.extents)
    assert not len(problem.point({}, {}).vehicle.vehicle().extents)
    answer = dict(problem.source) | POLE
    assert as_requirements(answer, tmp_path / "rig.yaml")["vehicle"] == []
    content = studio_content(answer, {"rig": POLE})
    assert (content["site"], content["scene"]) == ({}, TOWN)


def test_a_search_follows_the_kerbs(tmp_path):
    along = {"kerb": [0.5, 2.5], "z": [5, 8], "price": 3}
    problem = read_problem(search(tmp_path, zones={"kerbs": along, "corner": KERB}))
    names = [zone.name for zone in problem.space.zones]
    assert {"corner", "kerbs_1", "kerbs_2"} <= {*names}
    assert problem.file.search.zones["kerbs_1"].price == 3
    first = problem.space.zones[names.index("kerbs_1")]
    assert (first.z, len(first.polygon)) == ((5, 8), 4)
    lidar = MountedLidar("", "kerbs_1", Mount(*np.mean(first.polygon, axis=0), 6.0))
    for text in (problem.placement_text((lidar,)), problem.rigs_text({"rig": (lidar,)})):
        (tmp_path / "answer.yaml").write_text(text)
        file = read_rigs(tmp_path / "answer.yaml")
        assert file.site is not None
        assert {zone.name: zone for zone in file.zones}["kerbs_1"] == first
        assert not file.blocked(0, file.rigs[0].mounts[0].position)
    within = {"x": [5, 20], "y": [5, 20]}
    problem = read_problem(search(tmp_path, zones={"kerbs": along | within}))
    places = np.concatenate([zone.polygon for zone in problem.space.zones])
    assert places.min() >= 5
    assert places.max() <= 20


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({"zones": {"k": {"kerb": [2, 1], "z": 5}}}, "search.zones.k.kerb: expected .*min <= max"),
        ({"zones": {"k": {"kerb": [0, 1], "z": 5}}}, "search.zones.k.kerb.*expected more than 0"),
        ({"zones": {"k": {"kerb": 1, "z": 5, "lidars": 1}}}, "zones.k.lidars.*several"),
        ({"zones": {"k": {"kerb": 1, "z": 5, "x": [0, 1], "y": 0}}}, "zones.k.kerb: no kerb"),
        ({"vehicle": BODY}, ("search.yaml", "search.vehicle", "")),
        ({"zones": {"kerb": KERB | {"z": [5, 16]}}}, "zones.kerb.*15"),
        ({"zones": {"lane": {"x": [-2, 2], "y": [-2, 2], "z": [3, 8]}}}, "zones.lane.*vehicles"),
        ({"zones": {"over": {"x": [-80, 80], "y": [-80, 80], "z": 5}}}, "zones.over.*building"),
        ({"fixed": [{"x": 0, "y": 0, "z": 2}]}, "fixed.*vehicles"),
    ],
)
def test_zones_of_poles(tmp_path, settings, expected):
    with refused(expected):
        read_problem(search(tmp_path, **settings))


def test_only_sites_of_simulated_traffic_have_kerbs(tmp_path):
    path = search(tmp_path, zones={"k": {"kerb": 1, "z": 5}})
    with refused("zones.k.kerb: only a site has kerbs"):
        read_problem(path, ["site=null"])
    scene = write_log(tmp_path / "log")
    with refused("zones.k.kerb: no kerb.*lanes of a log are unknown"):
        read_problem(path, [f"scene={scene}", "site={x: 30, y: 0}"])
