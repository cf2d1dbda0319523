"""The worst case over dead LiDARs as an objective: against brute force."""

import itertools
from functools import reduce

import numpy as np
import pandas as pd
import pytest
from search_files import write_search
from test_search_generalist import written
from test_search_recall import objects_of, run
from typer.testing import CliRunner

from lidarplace import Lidar, Mount, Placement
from lidarplace.clouds.shade import ends_in_rig
from lidarplace.pog.selection import Limits
from lidarplace.recall.one_dead import OneDeadChoice
from lidarplace.recall.surface_cells import SurfaceCells
from sweeps.commands.search import app
from sweeps.search.greedy.objective_value import OneDeadWorth
from sweeps.search.judgement.robustness import _cases
from sweeps.search.problem.assess import Traffic, assess
from sweeps.search.problem.choice import Choice
from sweeps.search.problem.problem import read_problem
from sweeps.search.trials import by_generalist
from tests.mlflow_database import write_database
from tests.sweeps.small_log import write_small_log
from tracking.run_folders.search_json import SearchResult

OBJECTIVE = "one_lidar_dead.expected_recall.Car"


def worst(objects, rig):
    """The least expected recall of cars without one LiDAR, by the library; 0 of a single one."""
    values = []
    for dead in range(len(rig.mounts)):
        kept = [n for n in range(len(rig.mounts)) if n != dead]
        mounts, lidars = ([own[n] for n in kept] for own in (rig.mounts, rig.lidars))
        if kept:
            found = objects.of(Placement("left", mounts, lidars))
            values.append(float(found.loc["Car", "expected_recall"]))
    return min(values, default=0.0)


@pytest.mark.parametrize("pairs", [False, True])
def test_values_and_bound_of_all_subsets(tmp_path, pairs):
    write_small_log(tmp_path / "log")
    objects = objects_of(tmp_path)
    lidar = Lidar.even(4, (-20, 4), 120)
    spots = [(0.6, 0.5), (-0.3, 0.2), (0.1, 0.7), (1.2, 0.4), (0.9, 0.1), (-0.8, 0.6)]
    groups = [[Mount(x, y, 1.6 + 0.1 * i, pitch=0.03 * i)] for i, (x, y) in enumerate(spots)]
    if pairs:
        groups = [[*own, Mount(own[0].x, -own[0].y, own[0].z)] for own in groups[:4]]
    alone = [Placement("one", [mount], lidar) for own in groups for mount in own]
    seen = iter(objects.objects.seen_by(alone))
    choice = OneDeadChoice.of(objects, [[next(seen) for _ in own] for own in groups], {"Car": 1.0})
    sizes = np.array([[float(len(own)) for own in groups]])
    limits = Limits(sizes, np.array([4.0 if pairs else 3.0]))
    most = 2 if pairs else 3
    known = {}
    for size in range(1, most + 1):
        for some in itertools.combinations(range(len(groups)), size):
            rig = Placement("rig", [mount for n in some for mount in groups[n]], lidar)
            known[some] = worst(objects, rig)
            assert choice.value(some) == pytest.approx(known[some], rel=1e-12)
    first = (0,)
    expected = [choice.value([0, n]) - choice.value(first) for n in range(1, len(groups))]
    np.testing.assert_allclose(choice.gains(first)[1:], expected, atol=1e-12)
    worth, best = OneDeadWorth(choice), max(known.values())
    greedy = worth.greedy(limits)
    assert greedy.value == pytest.approx(known[tuple(sorted(greedy.chosen))], rel=1e-9)
    assert greedy.gains.sum() == pytest.approx(greedy.value)
    bound = worth.upper_bound(limits, greedy.chosen, 5.0)
    assert best <= bound.value * (1 + 1e-9)
    whole = choice.whole.upper_bound(limits, greedy.chosen, 5.0)
    assert bound.value < whole.value or pairs, "a LiDAR less"


def test_a_search_for_the_worst_case(tmp_path):
    search = {"objective": OBJECTIVE, "lidars": [2, 3], "trials": 4, "greedy": {"refine": 1}}
    search["greedy"] |= {"position_step": 0.5}
    result = run(tmp_path, search=search, robustness=None)
    assert result.exit_code == 0, result.output
    assert f"objective {OBJECTIVE}: is not submodular" in " ".join(result.stdout.split())
    about = SearchResult.read(tmp_path / "runs/small")
    assert any("not submodular" in caution for caution in about.cautions)
    objects = objects_of(tmp_path)
    problem = read_problem(tmp_path / "small.yaml")
    for name in ("found_1", "line", "greedy"):
        own = about.rigs[name]
        mounts = [Mount(*pose) for pose in own.mounts]
        rig = Placement("rig", mounts, [problem.models[model] for model in own.models])
        assert own.values[OBJECTIVE] == pytest.approx(worst(objects, rig), rel=1e-9)
    assert about.rigs["refined"].searched[OBJECTIVE] >= about.bound.greedy * (1 - 1e-9)
    assert about.rigs["found_1"].searched[OBJECTIVE] >= about.bound.greedy * (1 - 1e-9)


def test_a_front_of_price_against_the_worst_case(tmp_path):
    models = {
        "small": {"beams": 4, "azimuth_steps": 200, "price": 1},
        "large": {"beams": 16, "azimuth_steps": 400, "price": 9},
    }
    objective = ["price", OBJECTIVE, "expected_recall.Car"]
    search = {"objective": objective, "models": models, "sampler": "nsga2", "trials": 6}
    search["lidars"] = [1, 3]
    result = run(tmp_path, search=search, robustness=None)
    assert result.exit_code == 0, result.output
    assert "no bound: several objectives" in result.stdout
    trials = pd.read_parquet(tmp_path / "runs/small/trials.parquet")
    dead, whole = (trials[f"value.{name}"] for name in objective[1:])
    assert (dead <= whole).all()
    single = trials["value.price"].isin([1.0, 9.0])
    assert (dead[single] == 0).all()
    dry = CliRunner().invoke(app, [str(tmp_path / "small.yaml"), "--dry-run"])
    assert "no bound: several objectives" in dry.stdout


def test_a_generalist_judges_every_rig_without_each_lidar(tmp_path, monkeypatch):
    """A made-up metric: ten times the height of the lowest LiDAR, and one for each LiDAR."""

    def metrics(store, portions, truths, classes, ious, names):
        table = real(store, portions, truths, classes, ious, names)
        mounts = portions[0].params.collection.placement.mounts
        return table.assign(value=10 * min(mount.z for mount in mounts) + len(mounts))

    real = by_generalist.judged_metrics
    monkeypatch.setattr(by_generalist, "judged_metrics", metrics)
    objective = ["one_lidar_dead.generalist.recall", "price"]
    models = {"one": {"beams": 4, "azimuth_steps": 60, "price": 2}}
    search = {"objective": objective, "models": models, "trials": 2, "sampler": "nsga2"}
    write_database(tmp_path / "m.db")
    path = written(tmp_path, tracking={"uri": f"sqlite:///{tmp_path / 'm.db'}"}, search=search)
    result = CliRunner().invoke(app, [str(path)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    rigs = read_problem(path).training_rigs.values()
    assert [sum(own.dead for own in rig) for rig in rigs] == [0, 1] * 2, "it knows dead LiDARs"
    trials = pd.read_parquet(tmp_path / "runs/small/trials.parquet")
    heights = trials[[c for c in trials.columns if c.endswith(".z_m")]]
    left = heights.shape[1] - 1  # without the highest, the lowest is left
    expected = 10 * heights.min(axis=1) + left
    value = trials["value.one_lidar_dead.generalist.recall"]
    np.testing.assert_allclose(value, expected, atol=1e-6)
    about = SearchResult.read(tmp_path / "runs/small")
    assert "one_lidar_dead.generalist.recall" in about.rigs["found_1"].values


SIZED = {"name": "vlp16", "azimuth_steps": 900, "size_mm": [400, 400, 400]}
"""So large that whoever is behind it misses much."""
BEHIND = tuple(Choice("sized", "", Mount(x, 0.0, 2.0)) for x in (-0.5, 0.0, 0.5))


def test_a_dead_lidar_still_hides_in_recall_and_in_clouds(tmp_path):
    objectives = [OBJECTIVE, "expected_recall.Car", "price"]
    search = {"objective": objectives, "models": {"sized": SIZED | {"price": 1}}, "greedy": None}
    problem = read_problem(write_search(tmp_path, search=search, lidar="vlp16"))
    objects = objects_of(tmp_path)
    lidar = problem.models["sized"]
    mounts = [own.mount for own in BEHIND]
    by_hand, gone = [], []
    for number in range(3):
        left = [*mounts[:number], *mounts[number + 1 :]]
        whole = Placement("whole", mounts, lidar)
        # Each LiDAR as it is cast in the whole rig, and then without the dead one's part.
        own = [lidar for n, lidar in enumerate(objects.objects.in_rig(whole)) if n != number]
        seen = reduce(SurfaceCells.and_, objects.objects.cells_of(own))
        by_hand.append(float(objects.recall(seen).loc["Car", "expected_recall"]))
        found = objects.of(Placement("left", left, lidar))
        gone.append(float(found.loc["Car", "expected_recall"]))
    traffic = Traffic({"Car": None}, objects)
    values = assess(BEHIND, problem.question, traffic).values
    assert values[OBJECTIVE] == pytest.approx(min(by_hand), rel=1e-12)
    assert min(by_hand) < min(gone)
    failing = list(_cases(BEHIND, problem.file.robustness, 0))[-3:]
    assert [case for case, _ in failing] == [f"LiDAR {n} fails" for n in (1, 2, 3)]
    found = [assess(rig, problem.question, traffic).values for _, (rig,) in failing]
    assert [own["expected_recall.Car"] for own in found] == pytest.approx(by_hand, rel=1e-12)
    # A generalist gets clouds of the same: the dead LiDAR is part of the placement.
    settings = problem.placement_settings(failing[1][1][0])
    rig = settings.placement("dead", problem.models["lidar"])
    assert rig.mounts == (mounts[0], mounts[2])
    assert rig.dead == ((mounts[1], lidar),)
    assert [(own > 0).any() for own in ends_in_rig(rig)] == [True, True]


def test_a_single_lidar_leaves_nothing(tmp_path):
    search = {"objective": OBJECTIVE, "lidars": 1}
    fixed = search | {"fixed": [{"x": 0.0, "y": 0.0, "z": 1.9}]}
    assert read_problem(write_search(tmp_path, search=fixed)).question.objectives[0].one_lidar_dead
