"""Greedy choice, bound and refinement of a whole search, against every rig of the grid."""

import itertools

import pytest
import yaml

from lidarplace import ExpectedRecall, OccupancyGrid
from sweeps.configuration.file import ConfigError
from sweeps.search.greedy.candidates import grid_points
from sweeps.search.greedy.certificate import (
    certify,
    first_params,
    kept_certificate,
    slots_of,
    why_none,
)
from sweeps.search.problem.assess import Traffic, assess
from sweeps.search.problem.problem import read_problem
from sweeps.search.problem.rig import MountedLidar, ordered
from sweeps.search.problem.space import Assignment, rig_of
from tests.sweeps.search_files import train_log, write_search

COARSE = {"position_step": 0.6, "angle_step_deg": 10.0, "bound_seconds": 2.0, "refine": 0}

HATCH = {"x": [-0.3, 0.7], "y": [-0.4, 0.1], "z": [1.7, 2.5]}
MODELS = {
    "spinning": {"beams": 4, "azimuth_steps": 90, "price": 4},
    "flash": {"beams": 8, "azimuth_steps": 90, "azimuth_deg": [-60, 60], "price": 2},
}
BESIDE = {"name": "somebody on the left", "where": {"x": [-1, 1], "y": [2, 3]}}
BESIDE |= {"what": "Pedestrian", "at_least": {"points": 4}, "step": 0.5}
COUNTED = {
    "roof": {"x": [-0.5, 0.5], "y": 0, "z": [1.8, 2.0], "lidars": [0, 2], "models": ["spinning"]},
    "side": {"x": [0.6, 1.2], "y": 1.0, "z": 0.8, "lidars": [0, 1], "models": ["flash"]}
    | {"mirrored": True, "facing_deg": 45, "yaw_deg": [-10, 10], "price": 1},
    "nose": {"x": 2.4, "y": [-0.6, 0.6], "z": 0.6, "lidars": 1, "models": ["flash", "spinning"]},
}


def problem_of(folder, **changes):
    return read_problem(write_search(folder, search={"greedy": COARSE} | changes))


def traffic_of(problem):
    log, point = train_log(problem.file.scene.folder), problem.sweep().points[0].point
    of = (point.voxel_roi(), point.classes)
    grids = OccupancyGrid.by_class(log.boxes, *of, frames=len(log.frames))
    needs_objects = problem.criteria.needs_objects
    return Traffic(grids, ExpectedRecall.from_log(log, *of) if needs_objects else None)


def all_candidates(problem):
    """Every mount of the grid, or mirrored pair, whatever it violates."""
    candidates = {}
    for slot, model, zone, mount in grid_points(problem):
        candidates.setdefault(Assignment(slot, MountedLidar(model, zone.name, mount)).rig)
    return list(candidates)


def best_of_all(problem, traffic):
    """The best feasible rig of the grid, by the search's own evaluation."""
    fixed = ordered(problem.space.fixed)
    free = all_candidates(problem)
    best = 0.0
    for count in range(1, problem.space.numbers[-1] + 1):
        for parts in itertools.combinations(free, count):
            lidars = [lidar for part in parts for lidar in part]
            if slots_of(ordered(lidars), problem) is None:
                continue
            assessment = assess(ordered([*fixed, *lidars]), problem.criteria, traffic)
            if assessment.feasible:
                best = max(best, assessment.values[problem.criteria.objectives[0].name])
    return best


CASES = yaml.safe_load(
    """
two: {lidars: 2}
range: {lidars: [1, 3], roll_deg: 0, objective: covered_entropy}
distance: {lidars: 2, constraints: {distance: 0.7}}
recall: {lidars: 2, roll_deg: 0, objective: expected_recall}
recall of pairs:
  {lidars: [1, 3], symmetric: true, roll_deg: 0, objective: expected_recall.Car}
fixed: {lidars: 2, fixed: [{x: 2.4, z: 0.6}], roll_deg: 0}
symmetric: {lidars: [2, 3], symmetric: true}
step:
  {zones: {side: {x: 0, y: [0.2, 0.6], z: 2}}, lidars: 3, roll_deg: 0,
   greedy: {position_step: 0.2, angle_step_deg: 10.0, bound_seconds: 2.0, refine: 0}}
fixed price:
  {models: {only: {beams: 4, azimuth_steps: 90, price: 5}}, fixed: [{x: 2.4, z: 0.6}],
   constraints: {price: 12}, lidars: [1, 2], roll_deg: 0}
price:
  {models: {small: {beams: 2, azimuth_steps: 45, price: 1}, large: {beams: 8,
   azimuth_steps: 90, price: 3}}, constraints: {price: 5}, lidars: 3, roll_deg: 0}
power:
  {models: {small: {beams: 2, azimuth_steps: 45, power: 4}, large: {beams: 8,
   azimuth_steps: 90, power: 9.5}}, constraints: {power: 18}, lidars: 3, roll_deg: 0}
views:
  {models: {turn: {beams: 2, azimuth_steps: 90}, front: {beams: 6, azimuth_steps: 120,
   azimuth_deg: [-60, 60]}}, azimuth_stride: 6}
"""
) | {
    "keep out": {"lidars": 2, "roll_deg": 0, "keep_out": {"hatch": HATCH}},
    "requirements": {"lidars": [1, 2], "roll_deg": 0, "requirements": [BESIDE]},
    "zones": {"zones": COUNTED, "roll_deg": 0, "models": MODELS},
}
CASES["counts"] = CASES["zones"] | {
    "lidars": 3,
    "models": {name: model | {"count": [1, 2]} for name, model in MODELS.items()},
}
CASES["zones and price"] = CASES["zones"] | {"constraints": {"price": 9}}


@pytest.mark.parametrize("changes", CASES.values(), ids=CASES)
def test_no_rig_of_the_grid_exceeds_the_bound(tmp_path, changes):
    problem = problem_of(tmp_path, **changes)
    traffic = traffic_of(problem)
    certificate = certify(problem, traffic)
    best = best_of_all(problem, traffic)
    assert best > 0
    assert certificate.bound >= best * (1 - 1e-12)
    assert certificate.by_gains >= certificate.bound
    assessment = assess(certificate.rig, problem.criteria, traffic)
    if (placed := slots_of(certificate.rig, problem)) is not None:
        assert rig_of(placed, problem.space) == certificate.rig
        assert assessment.feasible
        assert certificate.value <= best * (1 + 1e-12)
        share = 0.5 if problem.file.search.by_zone else 0.63  # of a partition matroid; of a number
        assert certificate.value >= share * best
    name = problem.criteria.objectives[0].name
    assert assessment.values[name] == pytest.approx(certificate.value, rel=1e-9)


@pytest.mark.parametrize("symmetric", [False, True])
def test_refining_moves_lidars_to_better_places(tmp_path, symmetric):
    problem = problem_of(tmp_path, symmetric=symmetric, greedy=COARSE | {"refine": 2})
    traffic = traffic_of(problem)
    certificate = certify(problem, traffic)
    assert certificate.refined_value > certificate.value
    assert certificate.refined_from == "greedy"
    found = assess(certificate.refined, problem.criteria, traffic)
    assert found.feasible
    assert found.values["expected_ig"] == pytest.approx(certificate.refined_value, rel=1e-9)
    (params,) = first_params(problem, certificate)
    assert problem.space.rig(params) == certificate.refined


def test_a_certificate_is_kept_until_the_problem_changes(tmp_path):
    problem = problem_of(tmp_path)
    traffic = traffic_of(problem)
    path = tmp_path / "certificate.json"
    first = kept_certificate(problem, traffic, path)
    again = kept_certificate(problem, Traffic({}), path)  # nothing is computed
    assert again == first
    other = problem_of(tmp_path, lidars=1)
    assert kept_certificate(other, traffic, path).value < first.value
    key = f'"key": "{problem.key}"'
    for damage in ("", "[]", "{", "{}", f'{{{key}, "chosen": 1}}', f"{{{key}}}", "\x00"):
        path.write_text(damage, encoding="utf-8")
        with pytest.raises(ConfigError, match=r"certificate\.json: .*; remove it, and it is made"):
            kept_certificate(problem, traffic, path)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"objective": "s_mig"}, "not monotone and submodular"),
        ({"objective": {"by": "expected_ig", "direction": "minimize"}}, "not monotone"),
        ({"objective": "residual_entropy"}, "covered_entropy asks for the same"),
        ({"objective": ["expected_ig", "price"]}, "several objectives"),
        ({"greedy": None}, "set search.greedy"),
    ],
)
def test_where_there_is_no_bound_it_says_why(tmp_path, changes, reason):
    assert reason in why_none(problem_of(tmp_path, **changes))


def test_no_candidate_keeps_the_constraints(tmp_path):
    zones = {"low": {"x": [-0.5, 0.5], "y": [-0.6, 0.6], "z": [1.6, 1.7]}}
    problem = problem_of(tmp_path, zones=zones, constraints={"body_share": 0.0})
    assert certify(problem, traffic_of(problem)) is None


def test_only_rigs_that_keep_the_constraints_are_refined(tmp_path):
    mounts = [{"x": 0.0, "z": 2.0}, {"x": 0.5, "z": 2.0}]
    search = {"greedy": COARSE | {"refine": 1}, "constraints": {"distance": 0.7}}
    own = {"placements": {"mine": {"mounts": mounts}}, "search": search | {"start": ["mine"]}}
    problem = read_problem(write_search(tmp_path, **own))
    traffic = traffic_of(problem)
    certificate = certify(problem, traffic)
    assert certificate.refined_from == "greedy"
    assert assess(certificate.refined, problem.criteria, traffic).feasible


def test_models_that_a_stride_thins_unlike_have_no_bound(tmp_path):
    models = {
        "a": {"azimuth_steps": 90},
        "b": {"azimuth_steps": 60},
        "c": {"azimuth_steps": 600, "azimuth_deg": [-60, 60]},
    }
    assert "azimuth_stride 8" in why_none(problem_of(tmp_path, models=models, azimuth_stride=8))
    assert why_none(problem_of(tmp_path, models=models, azimuth_stride=30)) is None
    del models["a"], models["b"]
    for view in ([-60, 60], [-61.3, 17]):
        models["c"]["azimuth_deg"] = view
        assert why_none(problem_of(tmp_path, models=models, azimuth_stride=8)) is None
