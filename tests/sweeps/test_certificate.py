"""Greedy choice, bound and refinement of a whole search, against every rig of the grid."""

import itertools

import pytest
from search_files import write_search

from lidarplace import OccupancyGrid
from lidarplace.box_log import read_box_log
from sweeps.search.assess import assess
from sweeps.search.certificate import (
    candidates_of,
    certify,
    first_params,
    kept_certificate,
    slots_of,
    why_none,
)
from sweeps.search.placed import rig_of
from sweeps.search.problem import read_problem
from sweeps.search.rig import Rig

COARSE = {"position_step": 0.6, "angle_step_deg": 10.0, "bound_seconds": 2.0, "refine": 0}


def problem_of(folder, **changes):
    return read_problem(write_search(folder, search={"greedy": COARSE} | changes))


def grids_of(problem):
    log = read_box_log(problem.file.scene.folder)
    train = log.frames[log.frames["split"] == "train"]
    boxes = log.boxes[log.boxes["frame"].isin(train["frame"])]
    point = problem.sweep().points[0].point
    return OccupancyGrid.by_class(boxes, point.voxel_roi(), point.classes, frames=len(train))


def best_of_all(problem, grids):
    """The best feasible rig of the grid, by the search's own evaluation."""
    fixed = Rig.of(problem.space.fixed)
    free = [rig for rig in candidates_of(problem) if rig != fixed]
    best = 0.0
    for count in range(1, problem.space.numbers[-1] + 1):
        for parts in itertools.combinations(free, count):
            lidars = [lidar for part in parts for lidar in part.lidars]
            if len(lidars) not in problem.space.numbers:
                continue
            if problem.file.search.symmetric and sum(len(part.lidars) == 1 for part in parts) > 1:
                continue
            found = assess(Rig.of([*fixed.lidars, *lidars]), problem.question, grids)
            if found.feasible:
                best = max(best, found.values[problem.question.objectives[0].name])
    return best


@pytest.mark.parametrize(
    "changes",
    [
        {"lidars": 2},
        {"lidars": [1, 3], "roll_deg": 0, "objective": "covered_entropy"},
        {"lidars": 2, "constraints": {"distance": 0.7}},
        {"lidars": 2, "fixed": [{"x": 2.3, "z": 0.6}], "roll_deg": 0},
        {"lidars": [2, 3], "symmetric": True},
        {
            "lidars": 3,
            "roll_deg": 0,
            "models": {
                "small": {"beams": 2, "azimuth_steps": 45, "price": 1},
                "large": {"beams": 8, "azimuth_steps": 90, "price": 3},
            },
            "constraints": {"price": 5},
        },
    ],
    ids=["two", "range", "distance", "fixed", "symmetric", "price"],
)
def test_no_rig_of_the_grid_exceeds_the_bound(tmp_path, changes):
    problem = problem_of(tmp_path, **changes)
    grids = grids_of(problem)
    certificate = certify(problem, grids)
    best = best_of_all(problem, grids)
    assert certificate.bound >= best * (1 - 1e-12)
    assert certificate.by_gains >= certificate.bound
    assert certificate.value <= best * (1 + 1e-12)
    assert certificate.value >= 0.63 * best
    found = assess(certificate.rig, problem.question, grids)
    assert found.feasible
    name = problem.question.objectives[0].name
    assert found.values[name] == pytest.approx(certificate.value, rel=1e-9)


@pytest.mark.parametrize("symmetric", [False, True])
def test_refining_moves_lidars_to_better_places(tmp_path, symmetric):
    problem = problem_of(tmp_path, symmetric=symmetric, greedy=COARSE | {"refine": 2})
    grids = grids_of(problem)
    certificate = certify(problem, grids)
    assert certificate.refined_value > certificate.value
    assert certificate.refined_from == "greedy"
    found = assess(certificate.refined, problem.question, grids)
    assert found.feasible
    assert found.values["expected_ig"] == pytest.approx(certificate.refined_value, rel=1e-9)
    (params,) = first_params(problem, certificate)
    assert problem.space.rig(2, params) == certificate.refined


def test_slots_of_a_rig_give_it_back(tmp_path):
    problem = problem_of(tmp_path, lidars=[2, 3], symmetric=True)
    certificate = certify(problem, grids_of(problem))
    placed = slots_of(certificate.rig, problem)
    assert rig_of(placed, problem.space) == certificate.rig


def test_a_certificate_is_kept_until_the_problem_changes(tmp_path):
    problem = problem_of(tmp_path)
    grids = grids_of(problem)
    path = tmp_path / "certificate.json"
    first = kept_certificate(problem, grids, path)
    again = kept_certificate(problem, {}, path)  # nothing is computed
    assert again.history.equals(first.history)
    assert {k: v for k, v in vars(again).items() if k != "history"} == {
        k: v for k, v in vars(first).items() if k != "history"
    }
    other = problem_of(tmp_path, lidars=1)
    assert kept_certificate(other, grids, path).value < first.value


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"objective": "s_mig"}, "not monotone and submodular"),
        ({"objective": {"by": "expected_ig", "direction": "minimize"}}, "not monotone"),
        ({"objective": "residual_entropy"}, "covered_entropy asks for the same"),
        ({"objective": ["expected_ig", "price"]}, "several objectives"),
        ({"greedy": None}, "greedy is null"),
    ],
)
def test_where_there_is_no_bound_it_says_why(tmp_path, changes, reason):
    assert reason in why_none(problem_of(tmp_path, **changes))
