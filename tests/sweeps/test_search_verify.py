"""The verification of a search tells what the report of its sweep tells."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from lidarplace.base.metrics import EVERY_IOU
from sweeps.search.verification.verify import verified_table

Y = {
    "found_1": [72.0, 70.0, 71.0],
    "center": [75.0, 74.0, np.nan],
    "line": [60.0, 66.0, 63.0],
    "untrained": [np.nan, np.nan, np.nan],
    "unknown": [50.0, 51.0, 52.0],
}
JUDGED = {name: SimpleNamespace(role="paper") for name in Y if name != "unknown"}


def run(y, metrics=("AP_R40_3D",)):
    """A sweep's tables; an IoU that is not the class's is there, too."""
    rows = [
        (name, "Car", "d", seed, metric, iou, "all", value + (9 if iou < 0.7 else 0), 50)
        for name, values in y.items()
        for seed, value in enumerate(values)
        for metric in metrics
        for iou in (0.5, 0.7)
    ]
    columns = ["placement", "class", "detector", "seed", "metric", "iou", "difficulty", "value"]
    return SimpleNamespace(
        results=pd.DataFrame(rows, columns=[*columns, "ground_truths"]), left_out=None
    )


def table_of(run, baseline="center"):
    surrogate = dict.fromkeys(JUDGED, 1.5)
    table = verified_table(run.results, run.left_out, JUDGED, surrogate, baseline)
    return table.set_index("rig")


def test_a_metric_of_no_single_iou_is_told_like_others():
    one = run(Y)
    strict = one.results[one.results["iou"] == 0.7]
    overlap = strict.assign(metric="mean_overlap", iou=EVERY_IOU)
    both = SimpleNamespace(results=pd.concat([one.results, overlap]), left_out=None)
    table = table_of(both).reset_index()
    columns = ["value", "difference", "difference_low", "seeds"]
    table = table.set_index(["metric", "rig"])
    assert set(table.loc["mean_overlap", "iou"]) == {EVERY_IOU}
    ap, other = (table.loc[metric, columns] for metric in ("AP_R40_3D", "mean_overlap"))
    pd.testing.assert_frame_equal(ap, other)


def test_differences_hold_for_all_pairs_at_once():
    table = table_of(run(Y))
    assert table.index.tolist() == ["center", "found_1", "line"]
    groups = {name: np.array(y)[np.isfinite(y)] for name, y in Y.items() if name != "untrained"}
    theirs = stats.tukey_hsd(*groups.values())
    bounds = theirs.confidence_interval(0.95)
    names = list(groups)
    for name in ("found_1", "line"):
        at, row = (names.index(name), names.index("center")), table.loc[name]
        assert row["difference"] == pytest.approx(theirs.statistic[at])
        expected = (bounds.low[at], bounds.high[at])
        interval = (row["difference_low"], row["difference_high"])
        assert interval == pytest.approx(expected, abs=1e-3)
    assert table.loc["center", ["difference", "difference_low"]].isna().all()
    assert table["seeds"].to_dict() == {"center": 2, "found_1": 3, "line": 3}
    assert set(table["iou"]) == {0.7}
    assert set(table["surrogate"]) == {1.5}


def test_a_mean_has_the_spread_of_all_rigs():
    table = table_of(run(Y))
    values = [np.array(y)[np.isfinite(y)] for y in Y.values()]
    degrees = sum(max(len(y) - 1, 0) for y in values)
    variance = sum(((y - y.mean()) ** 2).sum() for y in values if len(y)) / degrees
    half = stats.t.ppf(0.975, degrees) * np.sqrt(variance / 3)
    assert table.loc["line", "value"] == 63
    assert table.loc["line", "high"] == pytest.approx(63 + half)


def test_one_seed_has_no_interval_and_no_baseline_no_difference():
    one = {name: y[:1] for name, y in Y.items()}
    table = table_of(run(one))
    assert table.loc["line", "difference"] == -15
    assert table[["low", "high", "difference_low", "difference_high"]].isna().all(axis=None)
    table = table_of(run(Y), baseline="untrained")
    assert table["difference"].isna().all()
    assert table["low"].notna().all()


def test_every_metric_has_its_own_order():
    table = table_of(run(Y, metrics=("recall", "AP_R40_3D", "AP_R11_3D")))
    assert table["metric"].value_counts().to_dict() == {"recall": 3, "AP_R40_3D": 3}
