"""The packaged correction against what was distilled from real logs; see docs/reality.md."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from lidarplace.configuration.correction import read_correction
from lidarplace.validation.comparison import log_ratio
from lidarplace.validation.fit import FitData
from lidarplace.validation.shadow import shadows
from lidarplace.validation.simulation import Returns

FACTS = json.loads((Path(__file__).parents[2] / "data" / "reality.json").read_text())


@pytest.fixture(scope="module")
def objects() -> pd.DataFrame:
    """Objects whose log ratios have the quantiles of the real ones, with as many tracks."""
    rows = []
    for route, name, distance, boxes, tracks, points, quantiles in FACTS["rows"]:
        shares = np.linspace(0.05, 0.95, len(quantiles))
        ratios = np.interp((np.arange(boxes) + 0.5) / boxes, shares, quantiles)
        for n, ratio in enumerate(ratios):
            rows.append((f"{route}", f"{name}{n % tracks}", route, name, distance, points,
                         points / 2**ratio))  # fmt: skip
    columns = ["scene", "object_id", "route", "class", "distance", "simulated", "real"]
    return pd.DataFrame(rows, columns=columns)


def problem(objects: pd.DataFrame) -> tuple[FitData, Returns, np.ndarray]:
    rows = objects.reset_index(drop=True)
    zeros = np.zeros(len(rows), np.int64)
    returns = Returns(
        np.arange(len(rows)), zeros, zeros,
        rows["simulated"].to_numpy(float), rows["distance"].to_numpy(float),
    )  # fmt: skip
    shares = np.ones(len(rows))
    return FitData.of(rows, returns, shares), returns, shares


def test_the_fit_on_three_logs_corrects_the_fourth(objects):
    bias, spread = [], []
    for route in objects["route"].unique():
        fitted = problem(objects[objects["route"] != route])[0].fit()
        assert fitted.distance is not None
        rows = objects[objects["route"] == route].reset_index(drop=True)
        _, returns, shares = problem(rows)
        points = fitted.points(returns, rows["class"].to_numpy(str), shares)
        ratio = log_ratio(points, rows["real"].to_numpy(float))
        bias.append(np.median(ratio))
        spread.append(np.median(np.abs(ratio)))
    assert abs(np.mean(bias)) <= 0.1
    assert np.mean(spread) <= 0.45
    shipped = log_ratio(objects["simulated"].to_numpy(float), objects["real"].to_numpy(float))
    assert np.median(shipped) > 0.3  # what there is to correct


def test_the_packaged_factors_are_those_of_the_facts(objects):
    fitted = problem(objects)[0].fit()
    packaged = read_correction("av2_fleet")
    at = 30.0
    for name in ("Car", "Cyclist", "Pedestrian"):
        share, expected = (f.factor[name] * np.exp(-at / f.distance) for f in (fitted, packaged))
        assert share == pytest.approx(expected, rel=0.15), name


def test_the_shadow_is_that_of_the_sweeps_and_of_each_log_by_itself():
    returned = {n: np.array(facts["shares"]) for n, facts in enumerate(FACTS["returned"])}
    every = shadows(list(returned.values()))
    mask = read_correction("av2_fleet").lidars["down_lidar"].mask.shares[0]
    np.testing.assert_allclose(every[1], mask, atol=0.02)
    assert (every[0] == 1).all()
    routes = [facts["route"] for facts in FACTS["returned"]]
    by_route = [shadows([s for s, r in zip(returned.values(), routes, strict=True) if r == route])
                for route in set(routes)]  # fmt: skip
    dark = [shadows_of_route[1] < 0.5 for shadows_of_route in by_route]
    assert (dark[0] == dark[1]).mean() > 0.95
    assert 0.05 < dark[0].mean() < 0.12
