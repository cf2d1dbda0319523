"""Regret: worlds drawn from the prior, limits, and a choice counted by hand."""

import numpy as np
import pandas as pd
import pytest

from tracking.findings.best_placement import best_placement
from tracking.report.sections.regret import AT_RANDOM, regrets
from tracking.statistics.posterior import expected_regret
from tracking.statistics.reliability import Noise


def worlds(times, n=6, seeds=3, draws=500):
    """Truth, found and said regret of two choices, in sd of the seeds: any, and a good one."""
    rng, rows = np.random.default_rng(7), []
    for i in range(times):
        between = np.abs(rng.standard_cauchy()) / np.sqrt(seeds)
        truth = between * rng.standard_normal(n)
        y = truth[:, None] + rng.standard_normal((n, seeds))
        means, noise = y.mean(axis=1), Noise.of(y)
        good = int(np.argmax(truth + between / 2 * rng.standard_normal(n)))
        said = expected_regret(means, noise, np.eye(n)[[0, good]], i, draws)
        sd = np.sqrt(noise.variance)
        for name, choice, found in zip(("any", "good"), (0, good), said, strict=True):
            real, measured = truth.max() - truth[choice], means.max() - means[choice]
            rows.append((name, means.std() / sd, real / sd, measured / sd, *found / sd))
    columns = ["choice", "spread", "true", "measured", "said", "low", "high"]
    return pd.DataFrame(rows, columns=columns)


def check(table):
    # Of data that spread as they do: the prior's tail would hide what noise does.
    any_choice = table[(table["choice"] == "any") & (table["spread"] < 2)]
    error = 4 * (any_choice["said"] - any_choice["true"]).std() / np.sqrt(len(any_choice))
    assert any_choice["said"].mean() == pytest.approx(any_choice["true"].mean(), abs=error)
    assert any_choice["measured"].mean() > any_choice["true"].mean() + error
    held = (table["low"] <= table["true"] + 1e-9) & (table["true"] <= table["high"] + 1e-9)
    for _, own in held.groupby(table["choice"]):
        assert own.mean() > 0.95 - 4 * np.sqrt(0.95 * 0.05 / len(own))


def test_what_is_expected_happens_and_what_is_measured_is_too_much():
    check(worlds(600))


@pytest.mark.long
def test_the_same_in_many_worlds():
    check(worlds(10_000, draws=2000))


def test_without_noise_it_is_the_distance_to_the_best():
    y = np.array([[3.0, 3.0], [5.0, 5.0], [4.0, 4.0]])
    noise = Noise.of(y)
    found = expected_regret(y[:, 0], noise, np.array([[1, 0, 0], [0, 1, 0], [1 / 3] * 3]))
    assert found.tolist() == [pytest.approx([x] * 3) for x in (2.0, 0.0, 1.0)]
    one = Noise.of(y[:, :1])
    assert np.isnan(expected_regret(y[:, 0], one, np.eye(3))).all()


def test_choices_of_surrogates():
    y = {"a": (70.0, 71), "b": (60.0, 61), "c": (66.0, 67)}
    rows = [(name, s, value) for name, own in y.items() for s, value in enumerate(own)]
    best = best_placement(pd.DataFrame(rows, columns=["placement", "seed", "value"]))
    surrogates = pd.DataFrame(
        {
            "covered_entropy": {"a": 1.0, "b": 2, "c": 3},
            "residual_entropy": {"a": 3.0, "b": 1, "c": 2},
            "m_sog": {"a": 5.0, "b": 5, "c": 4},
            "h_pog": {"a": 1.0, "b": 1, "c": 1},
        }
    )
    found = regrets(best, surrogates).set_index("surrogate")
    assert found["choice"].to_dict() == {
        "covered_entropy": "c",
        "residual_entropy": "b",
        "m_sog": "a, b",
        AT_RANDOM: "",
    }
    assert found["takes"].tolist() == ["highest", "lowest", "highest", "any"]
    assert found["behind"].tolist() == pytest.approx([4, 10, 5, 14 / 3])
    assert (found["low"] <= found["regret"]).all()
    assert (found["regret"] <= found["high"]).all()
    assert found["regret"]["residual_entropy"] == found["regret"].max()
