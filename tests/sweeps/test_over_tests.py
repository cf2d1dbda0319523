"""Worth of a rig in several tests, by hand; and of few frames, where the truth is known."""

import numpy as np
import pandas as pd
import pytest

from sweeps.results.trial_results import with_columns
from sweeps.search.trials.aggregate import left_out_over_tests, metrics_over_tests
from sweeps.search.trials.by_generalist import KEPT, PORTIONS, expected_on_all
from training.kitti_ap import evaluation

ROWS = [("Car", "AP_R40_3D", 0.7), ("Car", "recall", 0.5), ("all", "recall", 0.5)]


def metrics(values, truths):
    table = pd.DataFrame(ROWS, columns=["class", "metric", "iou"])
    return table.assign(difficulty="all", value=values, ground_truths=truths)


def left_out(values):
    """Make rows of the first and the last metric for each of two routes and for nothing."""
    rows = [(*ROWS[i], "route", name, 3) for i in (0, 2) for name in "ab"]
    rows += [(*ROWS[i], "nothing", "", 0) for i in (0, 2)]
    columns = ["class", "metric", "iou", "unit", "left_out", "ground_truths"]
    return pd.DataFrame(rows, columns=columns).assign(value=values)


TESTS = [metrics([50.0, 80.0, 70.0], 10), metrics([60.0, 60.0, np.nan], 20)]
TESTS += [metrics([40.0, 70.0, 90.0], 5)]


@pytest.mark.parametrize(("over", "values"), [("mean", [50, 70]), ("worst", [40, 60])])
def test_each_metric_is_taken_by_itself(over, values):
    merged = metrics_over_tests(TESTS, over)
    assert merged["value"].tolist()[:2] == values
    assert np.isnan(merged["value"].iloc[2])  # one of them had no object
    assert merged["ground_truths"].tolist() == [35] * 3
    keys = ["class", "metric", "iou"]
    pd.testing.assert_frame_equal(merged[keys], TESTS[0][keys])


@pytest.mark.parametrize(
    ("over", "values"),
    [
        # Without a route of the first traffic both of its vehicles change, the other stays.
        ("mean", [(52 + 62 + 40) / 3, (46 + 56 + 40) / 3, (50 + 60 + 43) / 3, (50 + 60 + 34) / 3]),
        ("worst", [40, 40, 43, 34]),
    ],
)
def test_a_route_is_left_out_of_all_vehicles_in_its_traffic(over, values):
    tables = [left_out([52.0, 46.0, 0, 0, 50, 0]), left_out([62.0, 56.0, 0, 0, 60, 0])]
    tables.append(left_out([43.0, 34.0, 0, 0, 40, 0]))
    merged = left_out_over_tests(tables, [1, 1, 2], over)
    rows = merged[merged["metric"] == "AP_R40_3D"]
    whole = rows[rows["unit"] == "nothing"]
    assert whole[["left_out", "value"]].to_numpy().tolist() == [["", {"mean": 50}.get(over, 40)]]
    rows = rows[rows["unit"] == "route"]
    assert rows["left_out"].tolist() == [f"traffic {n}: {r}" for n in (1, 2) for r in "ab"]
    np.testing.assert_allclose(rows["value"], values)


def test_one_test_stays_as_it_is():
    random = np.random.default_rng(3)
    box = {"x": 10.0, "y": 0.0, "z": 1.0, "length": 4.0, "width": 2.0, "height": 1.5, "yaw": 0.0}
    truths = pd.DataFrame([{"frame": f, "class": "Car", **box} for f in range(6)])
    truths = truths.assign(scene="s", object_id=[str(f) for f in range(6)])
    detections = truths.assign(score=random.uniform(size=6), x=10 + random.uniform(0, 2, 6))
    routes = pd.DataFrame({"scene": "s", "frame": range(6), "route": [0, 0, 1, 1, 2, 2]})
    whole = evaluation(truths, detections, routes, ["Car"])
    for over in ("mean", "worst"):
        pd.testing.assert_frame_equal(metrics_over_tests([whole.metrics], over), whole.metrics)
        left = left_out_over_tests([whole.left_out], [1], over)
        without_halves = whole.left_out[whole.left_out["unit"] != "half"]
        np.testing.assert_array_equal(left["value"], without_halves["value"])
        assert len(left) == len(without_halves) > 0
        assert not with_columns(left, {"placement": "line"}).isna().any(axis=None)


def rigs(rng, n, spread=1.0, noise=2.0):
    """Values on the first frames and on all: portions scatter around what a rig is worth."""
    worth = 80 + spread * rng.standard_normal(n)
    portions = worth[:, None] + noise * rng.standard_normal((n, PORTIONS))
    return portions[:, 0], portions.mean(axis=1)


def test_laggards_are_neither_flattered_nor_punished():
    """By the mean change of the leaders, as it was, laggards came out 2.2 points too low here."""
    rng, off, shifted = np.random.default_rng(0), [], []
    for _ in range(300):
        first, whole = rigs(rng, 60)
        leads = first >= np.quantile(first, 1 - 1 / KEPT)
        both = list(zip(first[leads], whole[leads], strict=True))
        expected = np.array([expected_on_all(one, both) for one in first[~leads]])
        off.append((expected - whole[~leads]).mean())
        shifted.append((first + (whole - first)[leads].mean() - whole)[~leads].mean())
    assert np.mean(shifted) < -1.5, np.mean(shifted)
    assert np.mean(off) == pytest.approx(0, abs=0.25)  # the slope is kept above 1 / PORTIONS


def test_the_line_of_exact_values_is_met():
    first = np.array([70.0, 74.0, 80.0, 82.0])
    both = [(x, 20 + 0.7 * x) for x in first]
    assert expected_on_all(60.0, both) == pytest.approx(62.0)


@pytest.mark.parametrize(
    ("both", "expected"),
    [
        ([], 50.0),
        ([(60.0, 58.0)], 48.0),
        ([(60.0, 58.0), (60.0, 62.0), (60.0, 60.0)], 50.0),  # equal: no slope is known
        ([(60.0, 70.0), (61.0, 60.0), (62.0, 50.0)], 60 - 11 / PORTIONS),  # against all sense
        ([(60.0, 50.0), (61.0, 60.0), (62.0, 70.0)], 49.0),
    ],
)
def test_few_pairs(both, expected):
    assert expected_on_all(50.0, both) == pytest.approx(expected)
