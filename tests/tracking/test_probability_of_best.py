"""The probability of being the best: brute force, and worlds drawn from the prior."""

import numpy as np
import pytest
from scipy import integrate, special

from tracking.statistics.posterior import probability_of_best
from tracking.statistics.reliability import Noise


def probability(y, **options):
    """`y`: placements with their values by seed, of any length."""
    table = np.full((len(y), max(map(len, y))), np.nan)
    for row, values in zip(table, y, strict=True):
        row[: len(values)] = values
    means = np.array([np.mean(values) for values in y])
    return probability_of_best(means, Noise.of(table), **options)


def test_two_placements_by_quadrature():
    """The lead of two is shrunk by the share of noise, and has its share of the variance."""
    lead, variance, degrees, seeds = 2.0, 1.5, 4, 3

    def joint(log_sd, noise, weigh):
        sd = np.exp(log_sd)
        # The chi-square's density of the pooled variance, and the normal one of the lead.
        of_variance = sd**-degrees * np.exp(-degrees * variance / (2 * sd**2))
        # The share of noise of a half-Cauchy ratio of sds is a beta variable of 1/2 and 1/2.
        of_variance /= np.sqrt(noise * (1 - noise))
        of_lead = np.sqrt(noise) / sd * np.exp(-(lead**2) * seeds * noise / (4 * sd**2))
        wins = special.ndtr((1 - noise) * lead / (sd * np.sqrt(2 / seeds * (1 - noise))))
        return of_variance * of_lead * (wins if weigh else 1)

    total, wins = (
        integrate.dblquad(joint, 1e-9, 1 - 1e-9, -4, 5, args=(weigh,), epsabs=1e-6)[0]
        for weigh in (False, True)
    )
    noise = Noise(np.array([seeds, seeds]), variance, degrees)
    found = probability_of_best(np.array([70.0, 72.0]), noise, draws=200_000)
    assert found[1] == pytest.approx(wins / total, abs=0.004)


def test_unequal_seeds_by_weighted_draws_from_the_prior():
    y = [[1.0, 2, 4], [3.0, 5, 7], [4.0, 5.5]]
    rng, size = np.random.default_rng(0), 1_000_000
    noise, sd = rng.beta(0.5, 0.5, size), np.exp(rng.uniform(-2, 3, size))
    common = rng.uniform(-20, 28, size)
    of_mean = np.mean([1 / len(values) for values in y]) * sd**2
    between = np.sqrt((1 / noise - 1) * of_mean)
    truth = common + between * rng.standard_normal((3, size))
    weight = np.ones(size)
    for expected, values in zip(truth, y, strict=True):
        for value in values:
            weight *= np.exp(-((value - expected) ** 2) / (2 * sd**2)) / sd
    brute = np.bincount(truth.argmax(axis=0), weight) / weight.sum()
    # Some 2,600 draws' worth of weight: four standard errors.
    assert probability(y) == pytest.approx(brute, abs=0.04)


def test_it_happens_as_often_as_said():
    """Worlds drawn from the prior; a flat prior would say 0.11 more than happens."""
    rng = np.random.default_rng(1)
    said, right, n, seeds = [], [], 6, 3
    for i in range(1500):
        between = np.abs(rng.standard_cauchy()) / np.sqrt(seeds)
        truth = between * rng.standard_normal(n)
        y = truth[:, None] + rng.standard_normal((n, seeds))
        found = probability(y, seed=i, draws=500)
        best = y.mean(axis=1).argmax()
        said.append(found[best])
        right.append(truth.argmax() == best)
    assert np.mean(said) == pytest.approx(np.mean(right), abs=3 * 0.5 / np.sqrt(len(said)))
    sure = np.array(said) > 0.9
    shares = np.mean(np.array(said)[sure]), np.mean(np.array(right)[sure])
    assert shares[0] == pytest.approx(shares[1], abs=3 * 0.2 / np.sqrt(sure.sum()))


def test_equal_placements_are_less_sure_the_more_there_are():
    """The best of 16 equals leads by chance; a flat prior says 0.38 on average."""
    rng = np.random.default_rng(0)
    said = [probability(rng.standard_normal((16, 3)), draws=500).max() for _ in range(200)]
    assert np.mean(said) < 0.22


def test_units_and_level_do_not_count():
    y = np.random.default_rng(0).normal(size=(5, 3))
    expected = probability(y)
    assert probability(1e-3 * y) == pytest.approx(expected, abs=1e-3)
    assert probability(80 + y) == pytest.approx(expected, abs=1e-3)


def test_stiff_cases():
    assert np.isnan(probability([[1.0], [2.0]])).all()
    assert probability([[1.0, 2.0]]).tolist() == [1.0]
    assert probability([[1.0, 1.0], [3.0, 3.0], [3.0, 3.0]]).tolist() == [0.0, 0.5, 0.5]
    assert probability([[2.0, 2.0]] * 4).tolist() == [0.25] * 4
    hardly = [[1.0, 1.0 + 1e-12], [3.0, 3.0], [2.0, 2.0 - 1e-12]]
    assert probability(hardly)[1] > 0.999
    far = [[0.0, 1.0, 2.0], [1e9, 1e9 + 1, 1e9 + 2]]
    assert probability(far)[1] > 0.999


def test_a_larger_lead_is_surer_however_few_the_seeds():
    """With a prior of thinner tails two seeds each would never be more than 97.5 % sure."""
    noise, said = Noise(np.array([2, 2]), variance=1.0, degrees=2), []
    for lead in (1.0, 10.0, 100.0, 1e4):
        said.append(probability_of_best(np.array([lead, 0.0]), noise)[0])
    assert said == sorted(said)
    assert said[2] > 0.99
    assert said[3] > 0.999
