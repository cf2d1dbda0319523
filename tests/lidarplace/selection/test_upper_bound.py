import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from lidarplace.pog.selection import Limits
from lidarplace.pog.selection.majorant import Majorant
from tests.lidarplace.selection.small_exposures import (
    SHAPES,
    best_of_all,
    exposure_of,
    exposures,
    feasible_sets,
    greedy,
    limits_of,
    upper_bound,
)


@settings(max_examples=50)
@given(st.data())
def test_never_below_the_best_of_all(data):
    exposure = data.draw(exposures())
    limits = data.draw(limits_of(exposure.candidates))
    chosen = greedy(exposure, limits).chosen
    bound = upper_bound(exposure, limits, chosen, seconds=0.05, blocks=data.draw(st.integers(1, 9)))
    best = best_of_all(exposure, limits)
    assert (bound.history["bound"] >= best).all()
    assert best <= bound.value <= bound.by_gains
    assert bound.value == bound.history["bound"].iloc[-1]
    assert (np.diff(bound.history["bound"]) <= 0).all()


@settings(max_examples=60)
@given(st.data())
def test_a_majorant_is_never_below_the_value_of_a_set(data):
    exposure = data.draw(exposures())
    candidates = exposure.candidates
    seed = data.draw(st.integers(0, 2**32 - 1))
    share = np.random.default_rng(seed).random(candidates) ** 2
    some = data.draw(st.sets(st.integers(0, max(0, candidates - 1)))) if candidates else set()
    for majorant in (Majorant.at(exposure, share), Majorant.of_set(exposure, sorted(some))):
        added = np.array([majorant.added(e).sum() for e in range(candidates)])
        for chosen in feasible_sets(Limits.at_most(candidates, candidates)):
            value = majorant.constant.sum() + added[list(chosen)].sum()
            assert value >= exposure.value(chosen) * (1 - 1e-12) - 1e-15


@pytest.mark.parametrize("seed", range(3))
def test_it_reaches_the_relaxation_of_maximum_coverage(seed):
    rng = np.random.default_rng(seed)
    covers = rng.random((10, 30)) < 0.2
    worth = rng.random(30)
    # max sum of worth * y, y <= 1, y_v <= sum of the x_e that cover v.
    candidates, voxels = covers.shape
    cost = np.concatenate([np.zeros(candidates), -worth])
    budget = np.concatenate([np.ones((1, candidates)), np.zeros((1, voxels))], axis=1)
    matrix = np.concatenate([np.hstack([-covers.T.astype(float), np.eye(voxels)]), budget])
    relaxed = linprog(cost, matrix, np.concatenate([np.zeros(voxels), [3.0]]), bounds=(0, 1))
    exposure, limits = exposure_of(covers, "cover", worth), Limits.at_most(3, candidates)
    chosen = greedy(exposure, limits).chosen
    bound = upper_bound(exposure, limits, chosen, seconds=20, relative_gap=1e-9, blocks=30)
    assert bound.value == pytest.approx(-relaxed.fun, rel=1e-6)


@pytest.mark.parametrize("shape", SHAPES)
def test_the_first_bound_is_that_of_the_largest_single_values(shape):
    rng = np.random.default_rng(5)
    exposure = exposure_of(rng.integers(0, 9, (8, 20)), shape, rng.random(20), rng.random(20))
    singles = sorted((exposure.value([e]) for e in range(8)), reverse=True)
    bound = upper_bound(exposure, Limits.at_most(3, 8), seconds=0)
    assert bound.value == bound.by_gains == pytest.approx(sum(singles[:3]), rel=1e-8)


@pytest.mark.parametrize("shape", SHAPES)
def test_candidates_that_exclude_each_other(shape):
    """Five at one place: the clique's row leaves one of them."""
    exposure = exposure_of(np.eye(5) * 3, shape)
    limits = Limits(np.ones((1, 5)), np.array([4.0]), np.eye(5, dtype=bool))
    found = greedy(exposure, limits)
    assert len(found.chosen) == 1
    assert upper_bound(exposure, limits, found.chosen).value == pytest.approx(found.value, rel=1e-6)


def test_where_nothing_can_be_chosen_or_gained():
    for exposure, limits in (
        (exposure_of(np.zeros((0, 3)), "cover"), Limits.at_most(2, 0)),
        (exposure_of(np.zeros((4, 3)), "information"), Limits.at_most(2, 4)),
        (exposure_of(np.ones((4, 3)), "cover", worth=np.zeros(3)), Limits.at_most(2, 4)),
        (exposure_of(np.ones((4, 3)), "cover"), Limits.at_most(0, 4)),
        (exposure_of(np.ones((4, 3)), "cover"), Limits(np.full((1, 4), 9.0), np.array([8.0]))),
    ):
        assert upper_bound(exposure, limits).value == pytest.approx(0.0, abs=1e-7)
