"""Detectors on recorded clouds against those on simulated ones: ranks, bias, the section."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from tests.tracking.made_up_run import report_of, write_run
from tracking.report.analysis import Analysis
from tracking.report.sections.recorded_clouds import (
    rank_agreement,
    recorded_clouds_section,
    side_by_side,
)
from tracking.run_folders.sweep import RunFolder

NAMES = tuple(f"p{i}" for i in range(6))
BOTH = ("recorded", "simulated")


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> RunFolder:
    folder = tmp_path_factory.mktemp("recorded") / "run"
    return RunFolder.read(write_run(folder, NAMES, detectors=("second", "pv_rcnn"), clouds=BOTH))


def test_agreement_by_hand(run):
    table = rank_agreement(run)
    assert set(table["class"]) == {"Car", "Pedestrian", "all"}, "no cyclist is in it"
    assert len(table) == 2 * 3
    row = table.query("`class` == 'Car' and detector == 'second'").iloc[0]
    rows = run.results.query(
        "`class` == 'Car' and metric == 'AP_R40_3D' and iou == 0.7 and detector == 'second'"
    )
    means = rows.groupby(["scene.clouds", "placement"])["value"].mean()
    real, simulated = (means[kind][list(NAMES)] for kind in BOTH)
    assert row["n"] == 6
    assert row["spearman"] == pytest.approx(stats.spearmanr(simulated, real).statistic)
    assert row["kendall"] == pytest.approx(stats.kendalltau(simulated, real).statistic)
    assert row["spearman_low"] < row["spearman"] < row["spearman_high"]
    interval = stats.ttest_1samp(simulated - real, 0).confidence_interval()
    expected = [(simulated - real).mean(), interval.low, interval.high]
    np.testing.assert_allclose(row[["bias", "bias_low", "bias_high"]].astype(float), expected)


def test_a_subset_without_its_simulated_twin_has_no_part(run):
    results = run.results
    gone = (results["placement"] == "p0") & (results["scene.clouds"] == "simulated")
    less = RunFolder(**vars(run) | {"results": results[~gone]})
    assert set(side_by_side(less)["placement"]) == set(NAMES[1:])
    assert set(rank_agreement(less)["n"]) == {5}


@pytest.mark.parametrize("kind", BOTH)
def test_no_section_without_both(run, made_up_run, kind):
    alone = RunFolder(**vars(run) | {"results": run.results[run.results["scene.clouds"] == kind]})
    for other in (alone, RunFolder.read(made_up_run)):
        assert recorded_clouds_section(Analysis(other)) is None


def test_three_subsets_have_ranks_and_no_interval(tmp_path):
    folder = write_run(tmp_path / "three", NAMES[:3], clouds=BOTH)
    page = report_of(folder, "recorded_clouds").read_text(encoding="utf-8")
    assert "Do simulated clouds rank placements as recorded ones do?" in page
    text = (folder / "report.md").read_text(encoding="utf-8")
    assert "3 placements are too few for an interval" in text
    table = pd.read_csv(folder / "tables" / "recorded-clouds-placements.csv")
    assert set(table["placement"]) == set(NAMES[:3])
    assert table["recorded (%)"].between(0, 100).all()
