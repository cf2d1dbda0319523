"""AP against seconds of training, in numbers, in the figure and in the report."""

from dataclasses import replace

import pandas as pd
import pytest

from tests.tracking.made_up_run import NAMES, report_of, write_run
from tracking.findings.training_cost import (
    COST_AXES,
    is_longest,
    summarise_cost,
    training_cost,
    varied_cost_axes,
)
from tracking.report.analysis import Analysis
from tracking.report.sections.training_cost import training_cost_figure, training_cost_section
from tracking.run_folders.sweep import RunFolder

TRAININGS = [(epochs, share) for epochs in (1, 4) for share in (0.25, 1.0)]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cost") / "cost"
    return RunFolder.read(write_run(folder, trainings=TRAININGS, densities=(40, 80)))


def test_error_is_what_the_longest_training_gains(run):
    cost = training_cost(run.results, run.curves, run.axes)
    assert len(cost) == 2 * len(run.trials)  # two classes have ground truth
    assert set(cost["class"]) == {"Car", "Pedestrian"}
    assert (cost["seconds"] == 8 * cost[COST_AXES[0]] * cost[COST_AXES[1]]).all()
    longest = (cost[COST_AXES[0]] == 4) & (cost[COST_AXES[1]] == 1.0)
    assert (cost["reference"] == longest).all()
    assert (cost.loc[longest, "error"] == 0).all()
    # By hand for one trial.
    one = "placement == 'line' and seed == 2 and `class` == 'Car' and `scene.density` == 80"
    short = "`training.epochs` == 1 and `training.frame_share` == 0.25"
    row = cost.query(f"{one} and {short}").iloc[0]
    rows = run.results.query(f"{one} and metric == 'AP_R40_3D' and iou == 0.7")
    rows = rows.set_index(list(COST_AXES))["value"]
    assert row["error"] == pytest.approx(rows[4, 1.0] - rows[1, 0.25])


def test_the_longest_training_of_many():
    trainings = {COST_AXES[0]: [10, 5, 20, 5, 1], COST_AXES[1]: [0.5, 1.0, 0.25, 0.5, 1.0]}
    table = pd.DataFrame({"detector": ["a", "a", "a", "b", "b"], **trainings})
    # Of detector a all see as many frames, but one sees each of them.
    assert is_longest(table, COST_AXES).tolist() == [False, True, False, True, False]
    assert is_longest(table[["detector"]], ()).all()
    alone = table[table.detector == "a"].drop(columns=COST_AXES[1])
    assert is_longest(alone, COST_AXES[:1]).tolist() == [False, False, True]


def test_a_longest_training_that_failed_leaves_no_error(run):
    failed = (run.results["placement"] == "line") & is_longest(run.results, run.axes)
    cost = training_cost(run.results[~failed], run.curves, run.axes)
    assert cost.loc[cost["placement"] == "line", "error"].isna().all()
    assert cost.loc[cost["placement"] == "center", "error"].notna().all()
    assert summarise_cost(cost, run.axes)["error"].notna().all()


def test_summary_ranks_placements_as_the_longest_training_does(run):
    cost = training_cost(run.results, run.curves, run.axes)
    part = cost[cost["scene.density"] == 40]
    summary = summarise_cost(part, COST_AXES).set_index(["class", *COST_AXES])
    longest = summary.loc["Car", 4, 1.0]
    assert longest["error"] == 0
    assert longest["kendall"] == pytest.approx(1)
    assert longest["reference"]
    assert summary.loc["Car", 1, 0.25]["error"] == pytest.approx(7.5, abs=1.5)
    assert summary.loc["Car", 1, 0.25]["seconds"] == 2
    means = part[part["class"] == "Car"].pivot_table("ap", "placement", list(COST_AXES))
    for key, value in means.rank().corr("kendall")[4, 1.0].items():
        assert summary.loc[("Car", *key), "kendall"] == pytest.approx(value)


def test_the_figure_has_a_point_a_training_and_a_star_for_the_longest(run):
    cost = training_cost(run.results, run.curves, run.axes)
    rows = summarise_cost(cost[(cost["class"] == "Car") & (cost["scene.density"] == 40)], COST_AXES)
    (line,) = training_cost_figure(rows, COST_AXES, "Car").data
    assert line.x.tolist() == [2, 8, 8, 32]
    assert [*zip(line.marker.symbol, line.y == 0, strict=True)][-1] == ("star", True)
    assert line.marker.symbol.count("star") == 1
    assert line.text[0] == "epochs = 1, frame_share = 0.25"


@pytest.mark.parametrize("trainings", [TRAININGS, [(1, 1.0), (4, 1.0)], []])
def test_the_report_has_the_cost_of_training_where_it_varied(tmp_path, trainings):
    run = RunFolder.read(write_run(tmp_path / "run", NAMES[:2], seeds=(1,), trainings=trainings))
    section = training_cost_section(Analysis(run))
    assert (section is not None) == bool(varied_cost_axes(run.results)) == bool(trainings)
    if section is not None:
        without = training_cost_section(Analysis(replace(run, curves=None)))
        assert "has no curves.parquet" in " ".join(without.notes)


def test_the_report_compares_placements_after_the_longest_training(tmp_path):
    folder = write_run(tmp_path / "run", NAMES[:2], seeds=(1,), trainings=TRAININGS)
    page = report_of(folder, "placements", "training_cost").read_text()
    assert "Training: error against run time" in page
    results = pd.read_parquet(folder / "results.parquet")
    longest = results[(results[COST_AXES[0]] == 4) & (results[COST_AXES[1]] == 1.0)]
    own = longest.query("`class` == 'Car' and metric == 'AP_R40_3D' and iou == 0.7")
    table = pd.read_csv(folder / "tables" / "placements-car.csv").set_index("placement")
    means = table["3D AP @ 0.7 (%) mean"].to_dict()
    assert means == pytest.approx(own.set_index("placement")["value"].to_dict())
    assert "pointpillars_tiny (longest)" in page
