"""A search whose objective a generalist measures."""

import math

import numpy as np
import pandas as pd
import pytest
import yaml
from scipy.spatial.transform import Rotation

from lidarplace import Lidar, Mount, Placement
from lidarplace.mounting.errors import MountingErrors
from sweeps.search.output.terminal import rig_warnings
from sweeps.search.problem.generalist_trials import generalists, trials_of_rigs
from sweeps.search.problem.problem import read_problem
from sweeps.search.problem.training_rigs import training_rigs
from sweeps.search.trials import by_generalist
from tests.sweeps.search_files import run_search, write_search
from tests.sweeps.small_log import write_small_log
from tracking.run_folders.search import SearchFolder

TINY = {"detector": "pointpillars_tiny", "training": {"epochs": 1, "batch_size": 1}}
TINY |= {"generalist": {"rigs": 4, "rigs_per_frame": 2, "epochs": 1}}
TINY |= {"lidar": {"azimuth_steps": 180}}


def written(folder, **changes):
    """A configuration with logs for the trials, the choice and the verification."""
    for name in ("trials", "choice"):
        if not (folder / name).exists():
            write_small_log(folder / name)
    names = {"search": "trials", "choice": "choice"}
    traffic = {key: {"scene.test_folder": str(folder / log)} for key, log in names.items()}
    settings = {"objective": "generalist", "traffic": traffic, "sampler": "random"}
    search = settings | {"trials": 6, "batch_size": 3} | changes.pop("search", {})
    return write_search(folder, **TINY | changes, search=search)


@pytest.mark.usefixtures("two_peers")
def test_one_training_evaluates_all_and_a_resumed_search_evaluates_nothing_again(
    tmp_path, monkeypatch
):
    def height(objective, classes, metrics):  # a tiny training finds nothing
        return float(metrics.attrs["height"])

    def metrics(store, portions, truths, classes, ious, names):
        table = real(store, portions, truths, classes, ious, names)
        table.attrs["height"] = 10 * portions[0].stage.collection.placement.mounts[0].z
        return table

    real = by_generalist.metrics_of_portions
    monkeypatch.setattr(by_generalist, "metrics_of_portions", metrics)
    monkeypatch.setattr(by_generalist, "weighted_value", height)
    path = written(tmp_path, search={"constraints": {"distance": 0.8}})
    run_search(path)
    store, folder = tmp_path / "runs/store", tmp_path / "runs/small"
    assert len(list(store.glob("pretrain/*"))) == 1
    assert not list(store.glob("finetune/*"))
    table = pd.read_parquet(folder / "trials.parquet")
    feasible = table[table["feasible"]]
    assert (~table["feasible"]).any()
    value = feasible["value.generalist.recall"]
    np.testing.assert_allclose(value, 10 * feasible["lidar_1.z_m"], atol=1e-9)
    detections = list(store.glob("detect/*"))
    # The first portion of all, the others of those that lead alone.
    assert len(feasible) < len(detections) < by_generalist.PORTIONS * len(feasible)
    before = {p: p.stat().st_mtime_ns for p in store.rglob("*") if p.is_file()}
    (folder / "optuna.journal").unlink()  # a search that lost its trials finds its detections
    run_search(path)
    after = {p: p.stat().st_mtime_ns for p in store.rglob("*") if p.is_file()}
    results = {p: t for p, t in before.items() if p.parent != store / "sweeps"}
    assert {p: after.get(p) for p in results} == results
    again = pd.read_parquet(folder / "trials.parquet")
    pd.testing.assert_frame_equal(again.drop(columns="seconds"), table.drop(columns="seconds"))
    run = SearchFolder.read(folder)
    assert run.search.baseline is not None
    assert run.chosen is not None
    best = [rig for rig in run.search.rigs.values() if rig.role == "found"]
    assert len(best) <= 8
    assert set(run.chosen["rig"]) == set(run.search.rigs)
    text = (folder / "search.html").read_text()
    assert "On traffic that the search did not see" in text
    sweep = yaml.safe_load((folder / "sweep.yaml").read_text())
    assert "evaluator" not in sweep  # it is verified by detectors of its own
    assert sweep["mounting_errors"] == {"offset": 0.01, "angle_deg": 0.5}


@pytest.mark.usefixtures("two_peers")
def test_a_rig_is_worth_its_worst_vehicle_in_its_worst_traffic(tmp_path, monkeypatch):
    def metrics(store, portions, truths, classes, ious, names):
        table = real(store, portions, truths, classes, ious, names)
        collection = portions[0].stage.collection
        assert not collection.errors  # all frames are of one vehicle
        farther = truths[0].inputs[0].stage.recording.scene.folder.name == "more"
        return table.assign(value=10 * collection.placement.mounts[0].z - 3 * farther)

    real = by_generalist.metrics_of_portions
    monkeypatch.setattr(by_generalist, "metrics_of_portions", metrics)
    write_small_log(tmp_path / "more", seed=1)
    logs = {"search": ["trials", "more"], "choice": ["choice"]}
    folders = {key: [str(tmp_path / name) for name in names] for key, names in logs.items()}
    traffic = {k: [{"scene.test_folder": log} for log in each] for k, each in folders.items()}
    settings = {"traffic": traffic, "vehicles": 2, "over": "worst", "trials": 3}
    printed = run_search(written(tmp_path, search=settings))
    description = "the worst over 2 kinds of traffic with 2 vehicles of a rig"
    assert f"evaluated by {description}" in " ".join(printed.split())
    assert len(list((tmp_path / "runs/store").glob("pretrain/*"))) == 1
    off = MountingErrors(0.01, math.radians(0.5))
    at_origin = Placement("origin", [Mount(0, 0, 0)], lidar=Lidar.paper())
    lowest = min(off.drawn(at_origin, 0, vehicle).mounts[0].z for vehicle in (1, 2))
    folder = SearchFolder.read(tmp_path / "runs/small")
    trials = folder.trials
    expected = 10 * (trials["lidar_1.z_m"] + lowest) - 3
    np.testing.assert_allclose(trials["value.generalist.recall"], expected, atol=1e-9)
    assert folder.search.over == description
    page = (folder.path / "search.html").read_text()
    assert "Each value is the worst over 2 vehicles of a rig." in page


@pytest.mark.usefixtures("two_peers")
def test_several_objectives_and_the_price_make_a_front(tmp_path):
    names = ["generalist.AP_R40_BEV.Car", "price"]
    models = {"small": {"beams": 4, "azimuth_steps": 180, "price": 2}}
    search = {"lidars": [1, 2], "objective": names, "models": models, "trials": 3}
    run_search(written(tmp_path, search=search))
    run = SearchFolder.read(tmp_path / "runs/small")
    assert [objective.name for objective in run.search.objectives] == names
    measured = run.trials[[f"value.{name}" for name in names]]
    assert measured[run.trials["feasible"]].notna().all(axis=None)


def test_training_rigs_are_of_the_space_and_of_every_number(tmp_path):
    problem = read_problem(written(tmp_path, search={"lidars": [1, 3]}))
    rigs = training_rigs(problem.space, problem.models, 9, 0)
    assert [len(rig) for rig in rigs.values()] == [1] * 3 + [2] * 3 + [3] * 3
    mounts = [choice.mount for rig in rigs.values() for choice in rig]
    assert all(-0.5 <= m.x <= 0.5 and -0.6 <= m.y <= 0.6 and 1.8 <= m.z <= 2.2 for m in mounts)
    assert any(mount.roll == 0 for mount in mounts)
    assert any(mount.roll != 0 for mount in mounts)
    assert rigs == training_rigs(problem.space, problem.models, 9, 0)
    assert rigs != training_rigs(problem.space, problem.models, 9, 1)


def simulated(folder, **search):
    """A search in simulated traffic, as its problem."""
    settings = {"objective": "generalist", "vehicles": 2} | search
    return read_problem(write_search(folder, **TINY | {"scene": {"seed": 5}}, search=settings))


def test_each_traffic_is_in_a_town_of_its_own_and_trials_and_choice_have_other_vehicles(tmp_path):
    dense = {"scene.density": 120}
    traffic = {"search": [{}, dense], "choice": {"scene.test_seed": 9}}
    tests = simulated(tmp_path, traffic=traffic).tests
    vehicle = "mounting_errors.vehicle"
    assert [test[vehicle] for test in tests.search] == [1, 2, 1, 2]
    assert [test["scene.test_seed"] for test in tests.search] == [1006, 1006, 1008, 1008]
    assert [test.get("scene.density") for test in tests.search] == [None, None, 120, 120]
    assert tests.choice == tuple({"scene.test_seed": 9, vehicle: v} for v in (3, 4))
    found = simulated(tmp_path, traffic={"search": {"scene.test_routes": 4}}).traffic
    assert found.search == ({"scene.test_routes": 4, "scene.test_seed": 1006},)
    assert found.choice == ({"scene.test_seed": 1007},)


def error(mount, exact):
    """By what a mount is off: metres, and the rotation vector in radians."""
    turned = Rotation.from_matrix(mount.rotation @ exact.rotation.T).as_rotvec()
    return [*(mount.position - exact.position), *turned]


def test_the_generalist_is_the_same_in_all_traffic_and_every_rig_is_off_alike(tmp_path):
    problem = simulated(tmp_path, traffic={"search": {"scene.density": 40}})
    trained = generalists(problem)
    rigs = {f"judged_{i}": rig for i, rig in enumerate(problem.paper_rigs().values())}
    trials = trials_of_rigs(problem, trained, rigs, problem.tests.search)
    (generalist,) = trained.values()
    scenes = [scene for clouds in generalist.inputs for scene in clouds.inputs]
    assert {scene.stage.recording.scene.density for scene in scenes} == {80}
    shifts = []
    for name, (of_seed,) in trials.items():
        exact = [choice.mount for choice in rigs[name]]
        assert all(trial.evaluate.inputs[0] is generalist for trial in of_seed)
        clouds = [next(t for t in r.evaluate.inputs if t.stage.name == "collect") for r in of_seed]
        assert {t.inputs[0].stage.recording.scene.density for t in clouds} == {40}
        mounts = [t.stage.placement.mounts for t in clouds]
        shifts.append(
            [[error(*pair) for pair in zip(drawn, exact, strict=True)] for drawn in mounts]
        )
    shifts = np.array(shifts)
    assert np.ptp(shifts, axis=0).max() < 1e-12
    first, second = shifts[0]
    assert (first != second).all()
    most = np.repeat([0.01, math.radians(0.5)], 3)
    assert (np.abs(shifts[0]) <= most).all()
    assert np.abs(shifts[0]).max(axis=(0, 1))[3:].min() > 0.0005  # radians, not degrees


def test_rigs_beyond_what_the_generalist_has_seen_are_told(tmp_path):
    problem = read_problem(written(tmp_path))  # two LiDARs, z from 1.8 to 2.2 m, upright or rolled
    drawn = problem.training_rigs["generalist_1"]
    assert not [text for text in rig_warnings({"own": drawn}, problem) if "generalist" in text]
    four = problem.paper_rigs()["pyramid_pitch"]
    (warning,) = [text for text in rig_warnings({"four": four}, problem) if "generalist" in text]
    assert warning.startswith(
        "Mounts are beyond those that the generalist was trained on in 1 rig: four ("
    )
    assert "pitch by " in warning
    assert warning.endswith(" deg, 4 LiDARs, not 2 to 2).")
    surrogate = read_problem(write_search(tmp_path))
    assert not [text for text in rig_warnings({"four": four}, surrogate) if "generalist" in text]


def test_a_dry_run_tells_of_a_rig_beyond_those_that_are_named(tmp_path):
    mounts = {name: [{"x": 0, "y": y, "z": z} for y in (-0.5, 0.5)] for name, z in PLACES.items()}
    placements = {name: {"mounts": mount} for name, mount in mounts.items()}
    changes = {"placements": placements, "generalist": {"rigs": ["low", "middle"]}}
    path = written(tmp_path, search={"start": ["high"]}, **changes)
    output = " ".join(run_search(path, "--dry-run").split())
    warning = (
        "Mounts are beyond those that the generalist was trained on in 1 rig: high (z by 0.15 m)."
    )
    assert warning in output


PLACES = {"low": 1.8, "middle": 2.0, "high": 2.15}
