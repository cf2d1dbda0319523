"""One detector for all rigs beside their own: as a candidate, in its section, with one seed."""

import json
import re

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from tests.tracking.made_up_run import report_of, write_run
from tracking.findings.ceiling import ceilings, with_ceilings
from tracking.findings.correlation import correlate
from tracking.findings.generalist import (
    calibration,
    compare,
    judgements,
    seconds_a_placement,
    with_judgements,
)
from tracking.findings.groups import groups
from tracking.findings.summary import seed_means
from tracking.report.analysis import Analysis
from tracking.report.headline import headline_ranking
from tracking.report.sections.coefficient_map import coefficient_map_section
from tracking.run_folders.sweep import RunFolder

NAMES = tuple(f"p{i}" for i in range(6))


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> RunFolder:
    folder = tmp_path_factory.mktemp("generalist") / "run"
    evaluators = ("generalist", "specialist", "finetuned")
    detectors = ("second", "pointpillars")
    return RunFolder.read(write_run(folder, NAMES, detectors=detectors, evaluators=evaluators))


def test_candidates_are_the_generalist_s_means_of_the_same_detector(run):
    table = judgements(run)
    one = table[(table["class"] == "Car") & (table["surrogate"] == "generalist's 3D AP")]
    same = "`class` == 'Car' and metric == 'AP_R40_3D' and iou == 0.7 and evaluator == 'generalist'"
    expected = run.results.query(same).groupby(["detector", "placement"])["value"].mean()
    for evaluator in ("specialist", "finetuned"):
        means = one[one["evaluator"] == evaluator].set_index(["detector", "placement"])["value"]
        pd.testing.assert_series_equal(means.sort_index(), expected.sort_index())
    assert set(one["evaluator"]) == {"specialist", "finetuned"}


def test_no_candidates_without_others(run, made_up_run):
    alone = run.results["evaluator"] == "generalist"
    for part in (alone, ~alone):
        assert judgements(RunFolder(**vars(run) | {"results": run.results[part]})).empty
    plain = RunFolder.read(made_up_run)
    assert with_judgements(plain) is plain.surrogates


def test_comparison_by_hand(run):
    surrogates = with_judgements(run)
    means = seed_means(run.results, run.axes, run.left_out)
    ceiling = ceilings(run.results, run.left_out, run.axes)
    table = with_ceilings(correlate(run.results, surrogates, run.axes), ceiling, run.axes)
    rows = compare(run, means, table)
    # 2 detectors, 2 other evaluators; 3D AP and recall of two classes with objects, recall of all.
    assert len(rows) == 2 * 2 * 5
    of_car = "`class` == 'Car' and metric == 'AP_R40_3D' and detector == 'second'"
    row = rows.query(f"{of_car} and evaluator == 'specialist'").iloc[0]
    specialist = run.results.query(f"{of_car} and iou == 0.7")
    values = specialist.groupby(["evaluator", "placement"])["value"].mean()
    generalist, specialist = values["generalist"], values["specialist"][values["generalist"].index]
    assert row["spearman"] == pytest.approx(stats.spearmanr(generalist, specialist).statistic)
    test = stats.ttest_1samp(generalist - specialist, 0).confidence_interval()
    expected = [(generalist - specialist).mean(), test.low, test.high]
    assert row[["bias", "bias_low", "bias_high"]].tolist() == pytest.approx(expected)
    assert row["slope"] == pytest.approx(np.polyfit(generalist, specialist, 1)[0])
    by_seeds = ceiling.query(f"{of_car} and iou == 0.7 and evaluator == 'specialist'")
    assert row["ceiling"] == by_seeds["ceiling_by_seeds"].item()


def test_slopes_and_biases_hold_the_truth():
    rng, held = np.random.default_rng(0), []
    for _ in range(400):
        generalist = rng.normal(70, 5, 8)
        specialist = 20 + 0.7 * generalist + rng.normal(0, 2, 8)
        line = calibration(generalist, specialist)
        held.append(line["slope_low"] <= 0.7 <= line["slope_high"])
    assert np.mean(held) == pytest.approx(0.95, abs=4 * np.sqrt(0.95 * 0.05 / 400))
    assert calibration(np.array([1.0, 1, 1]), np.array([1.0, 2, 3])) is None
    assert calibration(np.array([1.0, 2]), np.array([1.0, 2])) is None


def test_seconds(run):
    table = seconds_a_placement(run.trials).set_index(["detector", "evaluator"])
    assert table["trials"].tolist() == [12] * 6
    quick = table["seconds"].xs("generalist", level="evaluator")
    assert (quick < 5).all()
    assert (table["seconds"].xs("specialist", level="evaluator") > 60).all()


@pytest.mark.parametrize("axis", [True, False])
def test_one_generalist_has_intervals_of_the_test_objects(tmp_path, axis):
    """Whether the evaluator is an axis, or `sweep.json` says it."""
    folder = write_run(tmp_path / "run", NAMES, seeds=(1,), evaluators=("generalist",))
    about = json.loads((folder / "sweep.json").read_text())
    if not axis:
        about["axes"].remove("evaluator")
        about["evaluator"] = "generalist"
        for path in folder.glob("*.parquet"):
            table = pd.read_parquet(path)
            table.drop(columns="evaluator", errors="ignore").to_parquet(path, index=False)
    (folder / "sweep.json").write_text(json.dumps(about))
    run = RunFolder.read(folder)
    (group,) = groups(run)
    assert group.evaluator == "generalist"
    best = headline_ranking(run, group)["Car"]
    assert best.note.startswith("one generalist")
    assert (best.others["low"] < best.others["lead"]).all()
    means = seed_means(run.results, run.axes, run.left_out, run.sweep.evaluator)
    rows = means.query("`class` == 'Car' and metric == 'AP_R40_3D' and iou == 0.7")
    half = stats.t.ppf(0.975, best.sample.degrees) * np.sqrt(best.sample.variance)
    assert rows["half"].tolist() == pytest.approx([half] * len(NAMES))
    if axis:
        return
    page = report_of(folder).with_suffix(".md").read_text()
    assert "another one may rank the placements differently" in page
    assert "One seed: differences" not in page


def test_the_page_says_it_or_nothing_where_all_placements_are_equal(tmp_path):
    folder = write_run(tmp_path / "run", NAMES, evaluators=("generalist", "specialist"))

    def report():
        return report_of(folder, "generalist", "predictors").with_suffix(".md").read_text()

    text, regret = report(), "Regret: what the choice of each surrogate loses"
    assert "## Does one detector for all rigs rank them as their own do?" in text
    assert "one training, 250 s together" in text
    assert re.search(r"\| generalist's 3D AP \|", text)
    assert regret in text
    table = pd.read_csv(folder / "tables/generalist.csv")
    assert {"spearman", "ceiling", "bias (points)", "slope"} <= set(table)
    assert table["bias (points)"].tolist() == pytest.approx([20] * len(table), abs=4)
    for name in ("results", "left_out"):
        table = pd.read_parquet(folder / f"{name}.parquet")
        table.assign(value=table["value"] * 0).to_parquet(folder / f"{name}.parquet", index=False)
    text = report()
    assert regret not in text
    # Columns without a number are left out.
    assert "\n| Car | 3D AP @ 0.7 |\n" in text


def test_the_first_screen_has_the_generalist_among_the_predictors(tmp_path):
    evaluators = ("specialist", "generalist")
    run = RunFolder.read(write_run(tmp_path / "run", NAMES, evaluators=evaluators))
    section = coefficient_map_section(Analysis(run))
    assert "generalist's 3D AP" in section.figures[0].data[0].y
