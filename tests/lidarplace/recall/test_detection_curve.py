"""Detection curves: their shape, their fit against a plain search, their file."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidarplace.logs.boxes import CLASSES
from lidarplace.recall.detection_curve import (
    CELL_M,
    DetectionCurve,
    default_curves,
    fit,
    read_curves,
    write_curves,
)


def curve(most, rate, name="Car", iou=0.5):
    return DetectionCurve.model_validate({"class": name, "iou": iou, "most": most, "rate": rate})


@given(st.floats(1e-5, 1), st.floats(1e-5, 50))
def test_a_curve_rises_from_zero_and_is_concave(most, rate):
    p = curve(most, rate).probability(np.arange(300))
    steps = np.diff(p)
    assert p[0] == 0
    assert p.max() <= most
    assert (steps >= 0).all()
    assert (np.diff(steps) <= 1e-15).all()


def log_likelihood(most, rate, cells, found):
    p = most * (1 - np.exp(-rate * cells))
    return np.sum(np.log(np.where(found, p, 1 - p)))


def test_the_fit_is_the_best_of_a_fine_grid():
    rng = np.random.default_rng(4)
    cells = rng.integers(1, 120, 4000)
    found = rng.random(4000) < curve(0.83, 0.04).probability(cells)
    fitted = fit("Car", 0.5, cells, found)
    tries = [
        (log_likelihood(most, rate, cells, found), most, rate)
        for most in np.linspace(0.7, 0.95, 101)
        for rate in np.geomspace(0.02, 0.08, 101)
    ]
    best, most, rate = max(tries)
    assert log_likelihood(fitted.most, fitted.rate, cells, found) >= best - 1e-3
    assert fitted.most == pytest.approx(most, abs=0.005)
    assert fitted.rate == pytest.approx(rate, rel=0.03)
    assert fitted.most == pytest.approx(0.83, abs=0.03)


def test_shares_are_so_many_yes_and_no():
    cells = np.array([1, 5, 20, 60, 90])
    several = fit("Car", 0.5, np.repeat(cells, 4), [0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 1, 1] + 8 * [1])
    shares = fit("Car", 0.5, cells, [0, 0.25, 0.5, 1, 1])
    assert shares.most == pytest.approx(several.most, rel=1e-3)
    assert shares.rate == pytest.approx(several.rate, rel=1e-3)


def test_all_none_and_nothing_observed():
    cells = np.arange(1, 50)
    assert fit("Car", 0.5, cells, np.ones(49)).probability(1) > 0.99
    assert fit("Car", 0.5, cells, np.zeros(49)).probability(49) < 1e-3
    with pytest.raises(ValueError, match="no Car was observed"):
        fit("Car", 0.5, [], [])


def test_a_file_is_read_as_written(tmp_path):
    path = tmp_path / "curves.json"
    curves = [curve(0.9, 0.07), curve(0.7, 0.03, iou=0.7), curve(0.5, 0.2, "Cyclist")]
    write_curves(path, "python -m somewhere", curves)
    found = read_curves(path)
    assert found.curves == tuple(curves)
    assert found.command == "python -m somewhere"
    assert found.cell == CELL_M
    assert found.of("Car", 0.7).rate == 0.03


def test_the_default_has_all_classes():
    curves = default_curves()
    assert curves.cell == CELL_M
    assert "lidarplace calibrate" in curves.command
    for name in CLASSES:
        assert 0 < curves.of(name, 0.5).probability(30) < 1
