import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace.pog.selection import Limits, VoxelChoice
from tests.lidarplace.selection.small_exposures import (
    best_of_all,
    exposure_of,
    exposures,
    greedy,
    limits_of,
)
from tests.refused import refused


def plain_greedy(exposure, limits):
    """Every gain in every round, by differences of values."""
    chosen = []
    while True:
        value = exposure.value(chosen)
        gains = {
            e: exposure.value([*chosen, e]) - value
            for e in range(exposure.candidates)
            if e not in chosen and limits.allows(chosen, e)
        }
        if max(gains.values(), default=0.0) <= 1e-12:
            return chosen
        chosen.append(max(gains, key=lambda e: (round(gains[e], 9), -e)))


@settings(max_examples=60)
@given(st.data())
def test_lazy_is_plain_and_has_the_guarantee(data):
    exposure = data.draw(exposures())
    limits = Limits.at_most(data.draw(st.integers(0, 5)), exposure.candidates)
    found = greedy(exposure, limits)
    plain = plain_greedy(exposure, limits)
    assert found.value == pytest.approx(exposure.value(plain), rel=1e-6, abs=1e-8)
    assert found.evaluations <= exposure.candidates * (1 + len(found.chosen))
    assert found.value >= (1 - 1 / math.e) * best_of_all(exposure, limits) * (1 - 1e-12)


@settings(max_examples=60)
@given(st.data())
def test_what_is_chosen_is_feasible_and_adds_up(data):
    exposure = data.draw(exposures())
    limits = data.draw(limits_of(exposure.candidates))
    found = greedy(exposure, limits)
    chosen = list(found.chosen)
    assert len(set(chosen)) == len(chosen)
    assert (limits.used[:, chosen].sum(axis=1) <= limits.budgets + 1e-6).all()
    if limits.compatible is not None:
        pairs = limits.compatible[np.ix_(chosen, chosen)]
        assert pairs[~np.eye(len(chosen), dtype=bool)].all()
    for n, value in enumerate(found.values):
        assert value == pytest.approx(exposure.value(chosen[: n + 1]), rel=1e-12)
    np.testing.assert_allclose(np.diff(found.values), found.gains[1:], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    ("shape", "chosen", "value"), [("linear", (0, 1, 2), 6.3), ("cover", (0,), 3.0)]
)
def test_ties_go_to_the_lower_number_and_equal_candidates_cover_once(shape, chosen, value):
    found = greedy(exposure_of(np.ones((5, 3)), shape), Limits.at_most(3, 5))
    assert (found.chosen, found.value) == (chosen, pytest.approx(value))


def test_gain_per_cost_where_the_largest_gain_is_dear():
    amounts = np.zeros((4, 9))
    amounts[0, :4] = 1  # the largest, for the whole budget
    for small in (1, 2, 3):
        amounts[small, 3 * small - 3 : 3 * small] = 1
    exposure = exposure_of(amounts, "cover")
    limits = Limits(np.array([[3.0, 1.0, 1.0, 1.0]]), np.array([3.0]))
    found = greedy(exposure, limits)
    assert (found.rule, found.chosen, found.value) == ("gain per cost", (1, 2, 3), 9.0)


def test_a_price_of_tenths_keeps_its_budget_in_floating_point():
    exposure = exposure_of(np.eye(4), "cover")
    limits = Limits(np.full((1, 4), 0.1), np.array([0.3]))
    assert len(greedy(exposure, limits).chosen) == 3


@pytest.mark.parametrize("limits", [Limits.at_most(0, 3), Limits(np.ones((1, 3)), np.array([0.5]))])
def test_a_budget_that_excludes_everything(limits):
    found = greedy(exposure_of(np.ones((3, 2)), "cover"), limits)
    assert (found.chosen, found.value, found.evaluations) == ((), 0.0, 3)


def test_laziness_saves_evaluations():
    amounts = np.zeros((50, 50))
    np.fill_diagonal(amounts, 1)
    exposure = exposure_of(amounts, "cover", worth=np.arange(50.0))
    found = greedy(exposure, Limits.at_most(10, 50))
    assert found.chosen == tuple(range(49, 39, -1))
    assert found.evaluations == 50 + 9  # one more for each but the first


def test_limits_of_another_number_of_candidates_are_refused():
    choice = VoxelChoice(exposure_of(np.zeros((0, 3)), "cover"))
    for call in (choice.greedy, choice.upper_bound):
        with refused(("", "limits", "3")):
            call(Limits.at_most(1, 3))
