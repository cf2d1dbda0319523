"""Requirements in a search: as bounds, and their margin as an objective."""

import html
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidarplace import Mount
from lidarplace.configuration.placement import SweptPlacementSettings
from lidarplace.mounting.common_view import CommonView, common_view
from lidarplace.mounting.facing import facing_pairs
from lidarplace.mounting.limits import ROUNDING
from lidarplace.requirements.check_requirements import check_requirements
from sweeps.search.output.terminal import rig_warnings, warnings_of
from sweeps.search.problem.assess import Traffic, assess
from sweeps.search.problem.constraints import Constraint
from sweeps.search.problem.problem import read_problem
from sweeps.search.problem.rig import MountedLidar, placement_of
from sweeps.search.problem.search_config import as_plain
from tests.sweeps.search_files import ROOF, searched, write_search

AROUND = {"name": "somebody around", "where": {"distance": [1, 3]}, "what": "Pedestrian"}
AROUND |= {"at_least": {"points": 4}, "for": 0.9, "step": 1.0}
AROUND |= {"also_when": {"one_lidar_dead": True}}
EASY = AROUND | {"at_least": {"points": 2}, "for": 0.7, "also_when": {}}
LEFT = {"name": "the ground on the left", "where": {"x": [-1, 1], "y": [1.5, 3], "z": [0, 1]}}
LEFT |= {"at_least": {"coverage": 0.3}, "step": 0.5}
RIG = (
    MountedLidar("lidar", "roof", Mount(0.2, 0.5, 2.0, roll=-0.1)),
    MountedLidar("lidar", "roof", Mount(-0.2, -0.5, 2.0, roll=0.1)),
)


def problem_of(folder, **changes):
    search = {"requirements": [AROUND, LEFT], "greedy": None, "roll_deg": [-30, 30]} | changes
    return read_problem(write_search(folder, search=search))


def test_a_search_in_fog_has_lidars_in_fog(tmp_path):
    clear = write_search(tmp_path, search={"requirements": [AROUND], "greedy": None})
    fog = {"visibility": 3.0}
    wet = AROUND | {"also_when": {"weather": fog}}
    dim, cases = (
        read_problem(clear, [f"weather={fog}"]),
        read_problem(clear, [f"search.requirements={[wet]}"]),
    )
    assert dim.key != read_problem(clear).key
    problems = (dim, cases, read_problem(clear))
    seen = [problem.criteria.carrier.requirement_results(RIG)[0] for problem in problems]
    assert seen[0].cases[0].value == seen[1].cases[1].value < seen[2].cases[0].value
    assert seen[1].cases[1].case == "visibility 3 m"


def test_a_requirement_is_a_constraint_and_its_margin_an_objective(tmp_path):
    bounded = problem_of(tmp_path, objective="price")
    margin = problem_of(tmp_path, objective=["margin", "price"])
    carrier, rig = bounded.criteria.carrier, placement_of(RIG, bounded.models)
    outcomes = check_requirements(carrier.requirements, rig, carrier.vehicle)
    seen = [outcome.worst.value for outcome in outcomes]
    assert min(seen) > 0
    assessment = assess(RIG, bounded.criteria, Traffic({}, None))
    assert assessment.violations["requirement.somebody around"] == pytest.approx(4 - seen[0])
    assert assessment.violations["requirement.the ground on the left"] == pytest.approx(
        0.3 - seen[1]
    )
    free = assess(RIG, margin.criteria, Traffic({}, None))
    assert free.values["margin"] == pytest.approx(min(seen[0] / 4, seen[1] / 0.3))
    assert free.violations == assessment.violations


HIDDEN = {"name": "a child behind", "where": "un_r158", "at_least": {"points": 10}}
HIDDEN |= {"what": {"class": "child", "height": 0.8}}


@pytest.mark.parametrize(
    "objective", [["margin", "price"], pytest.param("price", marks=pytest.mark.long)]
)
def test_a_requirement_that_no_rig_meets(tmp_path, objective):
    search = {"requirements": [HIDDEN], "objective": objective, "greedy": None}
    models = {"models": {"small": {"name": "vlp16", "price": 1}}, "trials": 6}
    folder, printed = searched(tmp_path, code=1, search=search | models)
    enough = folder.trials["enough.requirement.a child behind"]
    first = (
        f"No rig meets the requirement 'a child behind': the closest, trial {enough.idxmax()}, has "
        f"0 of 10 points; {100 * enough.max():.0f} % of the positions have enough"
    )
    assert 0 < enough.max() < 1
    after = printed[printed.index("trials 6/6") :].splitlines()
    assert after[1] == first
    page = html.unescape((folder.path / "search.html").read_text(encoding="utf-8"))
    assert page.index(first) < page.index("Where the LiDARs sit")
    assert "Feasible" not in page
    assert folder.search.best == ()
    assert folder.search.feasible == 0
    assert not any(rig.feasible for rig in folder.search.rigs.values())
    assert not {"placement.yaml", "sweep.yaml"} & {file.name for file in folder.path.iterdir()}


def test_positions_that_have_enough_break_ties_for_the_sampler(tmp_path):
    models = {"small": "vlp16"}
    problem = problem_of(tmp_path, requirements=[HIDDEN], objective="margin", models=models)
    places = [[Mount(x, y, 2.0) for y in (-0.5, 0.5)] for x in (-0.5, 0.0, 0.5)]
    rigs = [tuple(MountedLidar("small", "roof", mount) for mount in mounts) for mounts in places]
    name = "requirement.a child behind"
    results = [assess(rig, problem.criteria, Traffic({}, None)) for rig in rigs]
    assert {(r.violations[name], r.values["margin"]) for r in results} == {(10.0, 0.0)}
    enough = [result.measures[f"enough.{name}"] for result in results]
    violations = [result.sampler_violations[name] for result in results]
    assert len(set(enough)) == 3
    assert np.argsort(violations).tolist() == np.argsort(enough)[::-1].tolist()


@given(st.floats(0.01, 1000), st.floats(0, 1000), st.floats(0, 1), st.booleans())
def test_what_the_sampler_is_told_is_positive_where_a_constraint_is_broken(
    limit, measure, enough, at_least
):
    constraint = Constraint("any", "", limit, at_least)
    violation = constraint.violation(measure)
    assert (constraint.sampler_violation(violation, enough) <= 0) == (violation <= 0)
    is_kept = measure >= limit if at_least else measure <= limit
    assert is_kept or violation > 0 or abs(measure - limit) < ROUNDING
    # What is at the limit but for rounding, as 0.6 - 0.4 is at 0.2, is at it.
    for off in (-ROUNDING / 2, ROUNDING / 2):
        assert constraint.violation(limit + off) == 0


def test_rigs_that_are_found_meet_all_requirements(tmp_path):
    view = {"name": "calibration", "common_view": {"pairs": "chain", "share": 0.3}}
    twice = EASY | {"at_least": {"points": 1, "sensors": 2}}
    search = {"requirements": [twice, LEFT, view], "roll_deg": [-30, 30], "trials": 16}
    folder, printed = searched(tmp_path, search=search)
    assert "requirement.somebody around at least 1 points by 2 sensors" in printed
    problem = read_problem(tmp_path / "small.yaml")
    feasible = folder.trials[folder.trials["feasible"]]
    assert 0 < len(feasible) < len(folder.trials)
    best = folder.search.rigs[folder.search.best[0]]
    rig = tuple(MountedLidar("lidar", "roof", mount) for mount in best.placed)
    outcomes = problem.criteria.carrier.requirement_results(rig)
    assert all(outcome.met for outcome in outcomes)
    cases = folder.requirements[folder.requirements["rig"] == folder.search.best[0]]
    assert cases["value"].tolist() == [f.value for result in outcomes for f in result.cases]
    assert cases["met"].all()
    ground = folder.grounds.under(folder.search.best[0], LEFT["name"])
    assert np.nanmin(ground.least) == outcomes[1].least_of.min()
    failed = folder.requirements[~folder.requirements["met"] & folder.requirements["x"].notna()]
    page = (folder.path / "search.html").read_text(encoding="utf-8")
    assert '<details class="folded"><summary><h2 id="requirements">' in page
    for rig, name in failed[["rig", "requirement"]].drop_duplicates().head(3).to_numpy():
        assert f"{rig} · {name}: FAIL" in page


def test_the_power_of_a_rig_is_that_of_its_models(tmp_path):
    models = {"own": {"beams": 2, "power": 3.5}, "bought": "vlp16"}
    models["hot"] = {"name": "vlp16", "power": 9}
    limits = {"constraints": {"power": 15, "distance": 0}, "objective": "power"}
    criteria = problem_of(tmp_path, models=models, **limits).criteria
    for name, watts in {"own": 3.5, "bought": 8.0, "hot": 9.0}.items():
        rig = tuple(MountedLidar(name, "roof", choice.mount) for choice in RIG)
        assessment = assess(rig, criteria, Traffic({}, None))
        assert assessment.values == {"power": 2 * watts}
        assert assessment.violations["power"] == 2 * watts - 15
    assert criteria.objectives[0].best == "minimize"


def test_zones_that_may_all_be_empty(tmp_path):
    zone = {"x": 0, "y": [0.2, 0.6], "z": 2, "lidars": [0, 1], "mirrored": True}
    search = {"zones": {"roof": zone}, "requirements": [EASY], "objective": ["margin", "price"]}
    search |= {"constraints": {"body_share": 0.9}, "greedy": None}
    trials = searched(tmp_path, search=search)[0].trials
    assert set(trials.loc[~trials["possible"], "lidars"]) <= {0}
    assert trials["possible"].any()


def test_pairs_of_lidars_as_constraints(tmp_path):
    """What calibration needs and what blinds, of a rig as of a placement by itself."""
    limits = {"common_view": {"pairs": "all", "share": 0.999}, "facing": 0}
    problem = problem_of(tmp_path, constraints=limits, requirements=[], objective="price")
    carrier = problem.criteria.carrier
    assessment = assess(RIG, problem.criteria, Traffic({}, None))
    rig = placement_of(RIG, problem.models)
    view = CommonView("all", 0.999, 20.0)
    (share,) = common_view(rig, carrier.vehicle, view).values()
    assert assessment.measures["common_view"] == share
    assert assessment.violations["common_view"] == pytest.approx(0.999 - share)
    assert assessment.violations["facing"] == len(facing_pairs(rig, carrier.vehicle)) == 1
    level = tuple(replace(lidar, mount=replace(lidar.mount, roll=0.0)) for lidar in RIG)
    assert assess(level, problem.criteria, Traffic({}, None)).measures["facing"] == 1
    apart = (level[0], replace(level[1], mount=replace(level[1].mount, z=2.5)))
    keys = [problem_of(tmp_path, constraints=lidar).key for lidar in (limits, {}, {"facing": 0})]
    assert len(set(keys)) == 3
    assert assess(apart, problem.criteria, Traffic({}, None)).violations["facing"] == 0
    assert any(
        "look into each other" in warning for warning in rig_warnings({"level": level}, problem)
    )
    assert not any("each other" in warning for warning in rig_warnings({"apart": apart}, problem))


def test_cameras_and_radars_that_every_rig_has(tmp_path):
    """They count in requirements, common view, price and power, and are of no rig's clouds."""
    both = EASY | {
        "at_least": {"points": 1, "pixels": 5, "sensors": 2, "kinds": 2},
        "where": {"x": [3, 5], "y": [-1, 1]}, "also_when": {},
    }  # fmt: skip
    camera = {"name": "front", "x": 0.5, "z": 1.6, "model": "a2d2_front_camera", "price": 7}
    radar = {"x": 2.3, "z": 0.5, "model": "drvegrd169", "price": 2, "power": 3.0}
    limits = {"constraints": {"price": 10, "common_view": {"pairs": "all", "share": 0.05}}}
    changes = {"requirements": [both], "objective": ["margin", "price"], **limits}
    with_them = problem_of(tmp_path, **changes, cameras=[camera], radars=[radar])
    assessment = assess(RIG, with_them.criteria, Traffic({}, None))
    alone = assess(RIG, problem_of(tmp_path, **changes).criteria, Traffic({}, None))
    name = "requirement.somebody around"
    assert assessment.measures[name] > 0 == alone.measures[name]
    assert assessment.values["price"] == alone.values["price"] + 9
    models = {"small": {"name": "vlp16", "price": 4}}
    priced = problem_of(tmp_path, **changes, models=models, zones={"roof": ROOF | {"price": 3}})
    rig = tuple(replace(lidar, model="small") for lidar in RIG)
    assert priced.criteria.carrier.total_of("price", rig) == 2 * (4 + 3)
    assert assessment.measures["common_view"] < alone.measures["common_view"]
    assert any("make no clouds" in warning for warning in warnings_of(with_them))
    assert with_them.key != problem_of(tmp_path, **changes).key
    found_rig = as_plain(with_them.placement_settings(RIG))
    again = SweptPlacementSettings.model_validate(found_rig)
    assert again.further() == with_them.criteria.carrier.further
