"""`promote`: who goes on, who is pruned, and that nothing else decides it."""

import math

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sweeps.configuration.grid import read_sweep
from sweeps.execution.backends import InProcess
from sweeps.execution.execute import Outcome, execute
from sweeps.execution.failures import Failure
from sweeps.plan.plan import make_plan
from sweeps.results.promotion import at_most, promote, survivors
from sweeps.results.trial_results import trial_failure
from sweeps.stages.collect import CollectStage
from sweeps.stages.evaluate import EvaluateStage
from sweeps.stages.measure import EvaluationResult
from sweeps.stages.surrogates import Scores, SurrogatesStage
from sweeps.stages.train import FinetuneStage
from sweeps.store.local import Store
from tests.sweeps.small_log import SMALL, write_sweep
from tests.sweeps.toy import Quiet, Toy, result
from tests.sweeps.written_tables import check_columns
from tracking.run_folders.sweep_tables import PROMOTIONS

PLACEMENTS = ["line", "center", "square", "pyramid"]
SWEEP = {
    "classes": ["Car", "Pedestrian"],
    "surrogate": SMALL["surrogate"] | {"names": ["s_mig", "covered_entropy", "m_sog"]},
    "training": {"epochs": 10},
    "grid": {"placement": PLACEMENTS, "seed": [1, 2]},
    "promote": [
        {"by": "covered_entropy", "keep": 3},
        {"by": "AP_R40_3D", "keep": 1, "set": {"training.epochs": 2}},
    ],
}


def read(folder, **changes):
    sweep = read_sweep(write_sweep(folder, **SWEEP | changes))
    return sweep, make_plan(sweep)


@pytest.fixture
def quick(monkeypatch):
    """Trainings and evaluations of no work; AP is what the test says, by placement and epochs."""
    ap, trained = {}, []

    def finetune(stage, *inputs, **how) -> Toy:
        mounts = stage.seed, stage.training.epochs, stage.point_range
        trained.append(mounts)
        return Toy([stage.seed, stage.training.epochs])

    def evaluate(stage, weights, clouds, *inputs) -> EvaluationResult:
        value = ap[clouds.n](*weights.n)
        columns = ["class", "metric", "iou", "difficulty", "value", "ground_truths"]
        rows = [("Car", "AP_R40_3D", 0.7, "all", value, 9)]
        return result(metrics=pd.DataFrame(rows, columns=columns))

    def collect(stage, log) -> Toy:
        return Toy(repr(stage.placement.mounts))

    monkeypatch.setattr(FinetuneStage, "run", finetune)
    monkeypatch.setattr(EvaluateStage, "run", evaluate)
    monkeypatch.setattr(CollectStage, "run", collect)
    return ap, trained


def mounts_of(plan, name):
    trial = next(trial for trial in plan.trials if trial.grid_point.point.placement == name)
    return repr(trial.collect_test[0].stage.placement.mounts)


def read_with(ap, folder, *values, **changes):
    """Read the sweep as `read` does, with an AP of each placement."""
    sweep, plan = read(folder, **changes)
    for name, value in zip(PLACEMENTS, values, strict=True):
        ap[mounts_of(plan, name)] = lambda seed, epochs, own=value: own + seed + epochs / 10
    return sweep, plan


def run(sweep, plan, folder, store=None):
    store, outcome = store or Store(folder / "store"), Outcome()

    def run_tasks(tasks):
        execute(tasks, store, InProcess(), Quiet(), outcome)
        return True

    return promote(sweep, plan, store, run_tasks), store, outcome


def test_cheap_stages_for_all_and_full_trainings_for_the_best(tmp_path, quick):
    ap, trained = quick
    sweep, plan = read_with(ap, tmp_path, 1.0, 2.0, 3.0, 0.0)
    promotion, store, outcome = run(sweep, plan, tmp_path)
    assert not outcome.failures
    assert promotion.complete
    table = promotion.table()
    check_columns(table, PROMOTIONS)
    first, second = (table[table["rung"] == number] for number in (0, 1))
    assert sorted(first["placement"]) == sorted(PLACEMENTS)
    values = {}
    for trial in plan.trials:
        surrogates = store.load(trial.surrogates).table
        entropies = surrogates[surrogates["surrogate"] == "covered_entropy"]["value"]
        values[trial.grid_point.point.placement] = math.fsum(entropies)
    assert dict(zip(first["placement"], first["value"], strict=True)) == values
    best = sorted(values, key=values.get, reverse=True)
    assert set(first.loc[first["kept"], "placement"]) == set(best[:3])
    assert set(second["placement"]) == set(best[:3])
    ap_of = dict(zip(PLACEMENTS, (1.0, 2.0, 3.0, 0.0), strict=True))
    expected = [ap_of[name] + 1.5 + 0.2 for name in second["placement"]]
    assert second["value"].tolist() == pytest.approx(expected), "mean over seeds, after two epochs"
    (winner,) = second.loc[second["kept"], "placement"]
    assert sorted((seed, epochs) for seed, epochs, _ in trained) == sorted(
        [(seed, 2) for seed in (1, 2)] * 3 + [(1, 10), (2, 10)]
    )
    for trial in plan.trials:
        name, rung = trial.grid_point.point.placement, trial.grid_point.rung
        expected = name not in best[:3] or (rung == 2 and name != winner)
        assert (trial.key in promotion.pruned) == expected
    loser = next(t for t in plan.trials if t.grid_point.point.placement == best[3])
    assert promotion.pruned[loser.key] == "rank 4 of 4 by covered_entropy (all), 3 kept"


def test_the_outcome_is_the_same_after_a_stop(tmp_path, quick):
    ap, trained = quick
    sweep, plan = read_with(ap, tmp_path, 1.0, 2.0, 1.0, 1.0)
    store, outcome, calls = Store(tmp_path / "stopped"), Outcome(), 0

    def stop_soon(tasks):
        nonlocal calls
        calls += 1
        execute(tasks[: 5 if calls > 1 else None], store, InProcess(), Quiet(), outcome)
        return calls < 2

    stopped = promote(sweep, plan, store, stop_soon)
    assert not stopped.complete
    whole, _, _ = run(sweep, plan, tmp_path)
    trained.clear()
    again = run(sweep, plan, tmp_path, store)[0]
    assert again.pruned == whole.pruned
    columns = ["rung", "placement", "value", "rank", "kept"]
    pd.testing.assert_frame_equal(again.table()[columns], whole.table()[columns])


@pytest.mark.parametrize(
    ("seeds", "error"),
    [((1, 2), ArithmeticError("the loss is nan")), ((1,), OSError(28, "No space left on device"))],
)
def test_a_placement_of_which_a_training_fails_does_not_go_on(tmp_path, quick, seeds, error):
    """A mean over the other seeds would not count."""
    ap, _ = quick
    sweep, plan = read_with(ap, tmp_path, 1.0, 9.0, 3.0, 0.0, promote=SWEEP["promote"][1:])

    def fails(seed, epochs):
        if seed in seeds:
            raise error
        return 99.0

    ap[mounts_of(plan, "center")] = fails
    promotion, _, outcome = run(sweep, plan, tmp_path)
    table = promotion.table().set_index("placement")
    assert table["kept"].to_dict() == dict.fromkeys(PLACEMENTS, False) | {"square": True}
    assert math.isnan(table.loc["center", "value"])
    assert table.loc["center", "rank"] == 4
    full = [t for t in plan.trials if t.grid_point.point.placement == "center"][-1]
    assert promotion.pruned[full.key] == "rung 0 has no AP_R40_3D of every seed"
    assert any(isinstance(f, Failure) for f in outcome.failures.values())


def test_a_failed_surrogate_is_a_failure_and_no_verdict(tmp_path, quick, monkeypatch):
    ap, trained = quick
    sweep, plan = read_with(ap, tmp_path, 1.0, 1.0, 1.0, 1.0)
    true = SurrogatesStage.run
    first = plan.trials[0]

    def fail(stage, pog) -> Scores:
        if stage == first.surrogates.stage:
            raise OSError(28, "No space left on device")
        return true(stage, pog)

    monkeypatch.setattr(SurrogatesStage, "run", fail)
    promotion, _, outcome = run(sweep, plan, tmp_path)
    name = first.grid_point.point.placement
    trials = [t for t in plan.trials if t.grid_point.point.placement == name]
    assert not any(trial.key in promotion.pruned for trial in trials)
    assert all(trial_failure(trial, outcome.failures) for trial in trials)
    assert trained, "the others go on"
    assert not {t.finetune.key for t in trials} & set(outcome.times)


def test_placements_compete_within_a_detector(tmp_path, quick):
    ap, _ = quick
    grid = SWEEP["grid"] | {"detector": ["pointpillars_tiny", "second_tiny"]}
    sweep, plan = read_with(ap, tmp_path, 4.0, 3.0, 2.0, 1.0, grid=grid)
    table = run(sweep, plan, tmp_path)[0].table()
    counts = table[table["kept"]].groupby(["rung", "detector"]).size()
    assert counts.to_dict() == {(n, d): (3, 1)[n] for n in (0, 1) for d in grid["detector"]}


def test_the_plan_counts_what_promotion_leaves(tmp_path):
    sweep, plan = read(tmp_path)
    trainings = [task for task in at_most(sweep, plan) if task.stage.name == "finetune"]
    assert len(trainings) == 3 * 2 + 1 * 2
    assert sum(task.stage.name == "finetune" for task in plan.tasks) == 2 * 4 * 2


finite = st.floats(-1e300, 1e300)


@given(st.lists(finite | st.just(math.nan), max_size=30), st.integers(1, 12), st.booleans())
def test_survivors_are_the_best(values, keep, highest):
    named = {str(i): value for i, value in enumerate(values)}
    best = survivors(named, keep, "maximize" if highest else "minimize")
    finite_values = {name: value for name, value in named.items() if math.isfinite(value)}
    assert best <= set(finite_values)
    assert len(best) >= min(keep, len(finite_values))
    order = sorted(finite_values.values(), reverse=highest)
    if len(finite_values) > keep:
        last = order[keep - 1]
        better = (lambda v: v >= last) if highest else (lambda v: v <= last)
        assert best == {name for name, value in finite_values.items() if better(value)}
