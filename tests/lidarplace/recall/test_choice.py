"""Greedy choice by expected recall, its bound, and the properties that they rest on."""

import itertools
from functools import cache

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarplace import Mount, Placement
from lidarplace.recall.choice import RecallChoice
from tests.lidarplace.recall.small_scenes import LIDAR, model_of, rows_of_cells, table_of
from tests.lidarplace.selection.small_exposures import feasible_sets, limits_of

WEIGHTS = {"Tram": 1.0, "Bus": 0.4}
model = cache(model_of)
choices = st.lists(rows_of_cells, max_size=5).map(
    lambda tables: RecallChoice(model(), [table_of(rows) for rows in tables], WEIGHTS)
)


def test_the_value_is_the_weighted_recall_of_the_rig():
    mounts = [Mount(0.1 * n, 0.2 * n - 0.4, 2.2 + 0.2 * n, roll=0.05 * n) for n in range(4)]
    ones = [Placement(str(n), [mount], lidar=LIDAR) for n, mount in enumerate(mounts)]
    choice = RecallChoice(model(), model().objects.seen_by(ones), WEIGHTS)
    found = model().of(Placement("rig", [mounts[1], mounts[3]], lidar=LIDAR))["expected_recall"]
    assert choice.value([3, 1]) == pytest.approx(found["Tram"] + 0.4 * found["Bus"], rel=1e-12)
    gains = choice.gains([1])
    assert gains[3] == pytest.approx(choice.value([1, 3]) - choice.value([1]), rel=1e-9)
    assert gains[1] == 0


@settings(max_examples=30)
@given(choices)
def test_it_is_monotone_and_submodular(choice):
    numbers = range(len(choice.seen))
    sizes = range(len(numbers) + 1)
    sets = [rig for size in sizes for rig in itertools.combinations(numbers, size)]
    gains = {rig: choice.gains(rig) for rig in sets}
    for large, of_large in gains.items():
        assert (of_large >= 0).all()
        for left_out in large:
            small = tuple(one for one in large if one != left_out)
            assert (gains[small] >= of_large - 1e-12).all()


@settings(max_examples=40)
@given(st.data(), choices)
def test_no_set_exceeds_the_bound(data, choice):
    limits = data.draw(limits_of(len(choice.seen)))
    greedy = choice.greedy(limits)
    best = max(choice.value(chosen) for chosen in feasible_sets(limits))
    found = choice.upper_bound(limits, greedy.chosen, seconds=0.05)
    bound = found.value
    assert greedy.value == pytest.approx(choice.value(greedy.chosen), rel=1e-9, abs=1e-12)
    assert greedy.value <= best + 1e-12
    assert bound >= best - 1e-12
    assert bound <= found.by_gains <= choice.upper_bound(limits, seconds=0).value + 1e-9
