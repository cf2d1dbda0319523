"""Fits of corrections to counts that are drawn from known factors and distances."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import minimize
from scipy.stats import binom, t

from lidarplace.validation.comparison import chances, scores
from lidarplace.validation.fit import MOST_RAYS, FitData
from lidarplace.validation.simulation import Returns

FACTORS = {"Car": 0.62, "Pedestrian": 0.90, "Cyclist": 0.45}
DISTANCE = 85.0


def drawn(seed: int, tracks: int = 60, mean: float = 8.0) -> FitData:
    """Boxes of a mean of simulated rays in each of two rows; real rays are another draw.

    Rays of a track have a correlation of 0.2."""
    random = np.random.default_rng(seed)
    class_of = np.resize([0, 1, 0, 2], tracks)
    track = np.repeat(np.arange(tracks), random.integers(1, 20, tracks))
    away = random.uniform(8.0, 70.0, tracks)[track]
    factor = np.array([*FACTORS.values()])[class_of]
    share = random.beta(4 * factor, 4 * (1 - factor))[track]
    ranges = away[:, None] + random.uniform(-3.0, 3.0, (len(track), 2))
    rays, real_rays = random.poisson(mean, (2, len(track), 2))
    real = random.binomial(real_rays, share[:, None] * np.exp(-ranges / DISTANCE)).sum(axis=1)
    box = np.repeat(np.arange(len(track)), 2)
    name = np.array([*FACTORS])[class_of[track]]
    counts = box, rays.ravel().astype(float), ranges.ravel()
    return FitData(track, name, real.astype(float), away, *counts)


@pytest.mark.parametrize("mean", [0.5, 4.0])
def test_sparse_objects_give_the_truth_and_intervals_that_hold_it(mean):
    logs, truth = 200, np.array([*FACTORS.values(), 1 / DISTANCE])
    numbers, held = np.empty((logs, 4)), np.empty((logs, 4), bool)
    for seed in range(logs):
        data = drawn(seed, mean=mean)
        fitted, ends = data.fit(), data.intervals()
        numbers[seed] = [*(fitted.factor[n] for n in FACTORS), 1 / (fitted.distance or math.inf)]
        near, far = ends["distance"]
        pairs = np.array([*(ends[name] for name in FACTORS), (1 / far, 1 / near)])
        held[seed] = (pairs[:, 0] <= truth) & (truth <= pairs[:, 1])
    error = numbers.std(axis=0) / math.sqrt(logs)
    np.testing.assert_array_less(np.abs(numbers.mean(axis=0) - truth), 3.5 * error)
    least, most = binom.ppf([1e-4, 1 - 1e-4], logs, [[0.95], [0.98]])[[0, 1], [0, 1]]
    assert (held.sum(axis=0) >= least).all()
    assert (held.sum(axis=0) <= most).all()


def test_the_fit_maximises_the_likelihood():
    data = drawn(3, tracks=80)
    names, class_of = np.unique(data.name, return_inverse=True)
    weight = 1 / (1 + np.bincount(data.box, data.rays) / MOST_RAYS)

    def loss(x: np.ndarray) -> float:
        returns = np.bincount(data.box, data.rays * np.exp(-x[3] / 100 * data.distance))
        expected = np.exp(x[:3])[class_of] * returns
        return float(weight @ (expected - data.real * np.log(expected)))

    best = minimize(loss, [0.0, 0.0, 0.0, 1.0], method="BFGS", options={"gtol": 1e-8})
    fitted = data.fit()
    np.testing.assert_allclose([fitted.factor[n] for n in names], np.exp(best.x[:3]), rtol=1e-5)
    assert fitted.distance == pytest.approx(100 / best.x[3], rel=1e-5)


def test_intervals_are_those_of_fits_without_each_track():
    data, fits = drawn(4, tracks=120), []
    for track in range(120):
        boxes, rows = data.track != track, (data.track != track)[data.box]
        number = np.cumsum(boxes) - 1
        part = replace(
            data, track=data.track[boxes], name=data.name[boxes], real=data.real[boxes],
            away=data.away[boxes], box=number[data.box[rows]], rays=data.rays[rows],
            distance=data.distance[rows],
        )  # fmt: skip
        fitted = part.fit()
        fits.append([*np.log([fitted.factor[n] for n in FACTORS]), 1 / fitted.distance])
    error = np.std(fits, axis=0) * math.sqrt(119)
    ends, fitted = data.intervals(), data.fit()
    widths = [math.log(high / low) / 2 for low, high in (ends[name] for name in FACTORS)]
    near, far = ends["distance"]
    widths.append((1 / near - 1 / far) / 2)
    quantiles = np.array(widths) / error
    assert (quantiles > t.isf(0.025, 119)).all()
    assert (quantiles < t.isf(0.025, 9)).all()
    assert all(
        low < fitted.factor[name] < high for name, (low, high) in ends.items() if name != "distance"
    )


def test_separated_counts_have_a_fit():
    data = drawn(5)
    rays = np.bincount(data.box, data.rays)
    every = replace(data, real=rays)  # as many as rays
    fitted, ends = every.fit(), every.intervals()
    assert set(fitted.factor.values()) == {1.0}
    assert fitted.distance is None
    assert ends["Car"] == pytest.approx((1.0, 1.0))
    assert min(ends["distance"]) > 1e9
    none = replace(data, real=np.where(data.name == "Car", 0.0, data.real))
    assert none.fit().factor["Car"] == 0.0
    assert none.intervals()["Car"] == pytest.approx((0.0, 1 - 0.05 ** (1 / 30)))


@pytest.mark.parametrize("size", [1e-12, 1.0, 1e12])
def test_counts_of_any_size_at_one_range_have_a_ratio_and_no_distance(size):
    data = drawn(6)
    rays = np.full(len(data.rays), 3.0 * size)
    ranges = np.full(len(rays), 50.0)
    same = replace(data, rays=rays, real=0.3 * rays[::2], away=ranges[::2], distance=ranges)
    fitted, ends = same.fit(), same.intervals()
    assert fitted.distance is None
    np.testing.assert_allclose(list(fitted.factor.values()), 0.15, rtol=1e-12)
    assert "distance" not in ends
    np.testing.assert_allclose(list(ends.values()), 0.15, rtol=1e-6)


def of_boxes(classes: list[str], tracks: list[int], real: list[float]) -> FitData:
    number = np.arange(len(real))
    objects = pd.DataFrame(
        {"scene": "a", "object_id": tracks, "class": classes, "distance": 20.0, "real": real}
    )
    zeros, points = np.zeros(len(real), int), np.full(len(real), 10.0)
    return FitData.of(
        objects, Returns(number, zeros, zeros, points, 20.0 + number), np.ones(len(real))
    )


def test_few_tracks_of_a_class_do_not_decide():
    classes = ["Car"] * 50 + ["Truck"] * 9
    data = of_boxes(classes, list(range(59)), [5.0] * 50 + [10.0] * 9)
    assert set(data.name) == {"Car"}
    assert data.fit().factor == {"Car": pytest.approx(0.5), "other": pytest.approx(0.5)}
    more = of_boxes([*classes, "Bus"], list(range(60)), [5.0] * 50 + [10.0] * 10)
    assert more.fit().factor["other"] > 0.9


def test_one_object_has_a_ratio_and_no_interval():
    data = of_boxes(["Car", "Car"], [1, 1], [3.0, 0.0])
    assert data.fit().factor == {"other": pytest.approx(0.15)}
    assert data.intervals() == {}
    with pytest.raises(ValueError, match="real and simulated"):
        of_boxes(["Car"], [1], [0.0])


@pytest.mark.parametrize("most", [15, 40, 200])
def test_the_true_share_of_returns_has_no_bias(most):
    random = np.random.default_rng(0)
    rays = random.integers(1, most + 1, 20_000)
    real, expected = random.binomial(rays, 0.6).astype(float), 0.6 * rays
    assert abs(scores(expected, real, chances(rays.astype(float), expected))["bias"]) <= 0.01


def test_objects_without_real_points_are_beyond_a_factor_2():
    simulated, real = np.array([4.9, 5.0, 8.0, 8.0]), np.array([0.0, 0.0, 8.0, 5.0])
    values = scores(simulated, real, chances(np.full(4, 20.0), simulated))
    assert values["within_2"] == pytest.approx(2 / 3)
    assert values["bias"] == pytest.approx(math.log2(8 / 5))
