"""Savings and risks of promotion, by hand for a made-up run."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.tracking.made_up_run import report_of, write_run
from tracking.findings import promotion
from tracking.report.analysis import Analysis
from tracking.report.sections.promotion import promotion_section
from tracking.run_folders.sweep import RunFolder
from tracking.run_folders.sweep_json import Rung

EPOCHS = "training.epochs"
SHORT, FULL = 2, 10
RUNGS = [
    {"by": "expected_ig", "class": "Car", "keep": 8, "set": {}},
    {"by": "AP_R40_3D", "class": "Car", "keep": 3, "set": {EPOCHS: SHORT}},
]


def _write_promotion(
    path: Path,
    placements: int = 40,
    kept: tuple[int, int] = (8, 3),
    detectors: Sequence[str] = ("pointpillars_tiny",),
    **further: object,
) -> Path:
    """`placements` ranked by expected IG, kept[0] by a short training, kept[1] trained in full."""
    names = [f"p{i:02d}" for i in range(placements)]
    trainings = [(SHORT, 1.0), (FULL, 1.0)]
    write_run(path, names, trainings=trainings, detectors=detectors, **further)
    trials, results, surrogates, curves = (
        pd.read_parquet(path / f"{name}.parquet")
        for name in ("trials", "results", "surrogates", "curves")
    )
    car = surrogates.query("surrogate == 'expected_ig' and `class` == 'Car'")
    gain = car.set_index("placement")["value"].sort_values(ascending=False)
    short = results.query("`class` == 'Car' and metric == 'AP_R40_3D' and iou == 0.7")
    short = short[short[EPOCHS] == SHORT]
    rows = []
    for detector in detectors:
        second = gain.index[: kept[0]]
        ap_of_second = short[(short["detector"] == detector) & short["placement"].isin(second)]
        ap = ap_of_second.groupby("placement")["value"].mean().sort_values(ascending=False)
        for rung, values in enumerate((gain, ap)):
            for rank, (name, value) in enumerate(values.items(), start=1):
                seconds = 0.05
                if rung:
                    match = (trials["placement"] == name) & (trials["detector"] == detector)
                    seconds = trials.loc[match & (trials[EPOCHS] == SHORT), "seconds"].sum()
                    seconds *= SHORT / FULL
                row = {"rung": rung, "detector": detector, "placement": name, "class": "Car"}
                row |= {"by": RUNGS[rung]["by"], "value": value, "rank": rank, "seconds": seconds}
                row |= {"kept": rank <= kept[rung], "setting": f"{EPOCHS}={SHORT}" if rung else ""}
                rows.append(row)
        for epochs, reached in ((SHORT, set(second)), (FULL, set(ap.index[: kept[1]]))):
            pruned = (trials["detector"] == detector) & (trials[EPOCHS] == epochs)
            pruned &= ~trials["placement"].isin(reached)
            reason = f"{placements} by expected_ig (Car), {kept[0]} kept"
            trials.loc[pruned, ["status", "error"]] = "pruned", reason
            trials.loc[pruned, "seconds"] = np.nan
    trials["seconds"] *= trials[EPOCHS] / FULL
    gone = trials.loc[trials["status"] == "pruned", "trial"]
    tables = {"promotions": pd.DataFrame(rows), "trials": trials}
    tables["results"] = results[~results["trial"].isin(gone)]
    tables["curves"] = curves[~curves["trial"].isin(gone)]
    for name, table in tables.items():
        table.to_parquet(path / f"{name}.parquet", index=False)
    sweep = json.loads((path / "sweep.json").read_text())
    (path / "sweep.json").write_text(json.dumps(sweep | {"promote": RUNGS}))
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("promotion") / "promotion"
    return _write_promotion(path, detectors=("tiny", "second"))


@pytest.fixture(scope="module")
def run(folder):
    return RunFolder.read(folder)


@pytest.fixture(scope="module")
def group(run):
    return next(promotion.promoted(run))


def _full(run, detector="tiny"):
    full = run.trials[(run.trials["detector"] == detector) & (run.trials[EPOCHS] == FULL)]
    return full[full["status"] == "finished"]


def test_a_group_has_its_rungs_and_its_full_trainings(run, group):
    assert group.title == "tiny"
    rungs = ("rung 1: expected IG (Car)", "rung 2: 3D AP @ 0.7 (Car), epochs = 2")
    assert group.stages == (*rungs, promotion.FULL_TRAINING)
    assert (group.placements, group.seeds) == (40, 2)
    assert set(group.trials["trial"]) == set(_full(run)["trial"])
    of_car = "`class` == 'Car' and metric == 'AP_R40_3D' and iou == 0.7"
    rows = run.results.query(f"detector == 'tiny' and {of_car}")
    means = rows[rows[EPOCHS] == FULL].groupby("placement")["value"].mean()
    assert group.ap.to_dict() == pytest.approx(means.to_dict())
    assert len(means) == 3


def test_the_ap_of_all_classes_is_the_mean_of_those_with_ground_truth(run):
    of_all = run.promotions.assign(**{"class": "all"})
    group = next(promotion.promoted(replace(run, promotions=of_all)))
    ap = run.results.query("detector == 'tiny' and metric == 'AP_R40_3D'")
    ap = ap[ap[EPOCHS] == FULL].set_index(["class", "iou"])["value"]
    both = ap["Car", 0.7].mean(), ap["Pedestrian", 0.5].mean()
    assert group.ap.mean() == pytest.approx(sum(both) / 2)


def test_ranks_end_where_a_placement_was_pruned(group):
    ranks = promotion.stage_ranks(group)
    assert ranks.notna().sum().tolist() == [40, 8, 3]
    for column in ranks:
        finite_ranks = ranks[column].dropna()
        assert sorted(finite_ranks) == list(range(1, len(finite_ranks) + 1))
    assert (ranks[0] <= 8).equals(ranks[1].notna())
    assert (ranks[1] <= 3).equals(ranks[promotion.FULL_TRAINING].notna())


def test_costs_and_savings_add_up(run, group):
    costs = promotion.stages(group).set_index("stage")
    assert costs["placements"].tolist() == [40, 8, 3]
    assert costs["kept"].tolist() == [8, 3, 0]
    full = _full(run)["seconds"]
    assert costs.loc[promotion.FULL_TRAINING, "seconds"] == pytest.approx(full.sum())
    assert costs.loc[promotion.FULL_TRAINING, "seconds_each"] == pytest.approx(2 * full.mean())
    rows = run.trials[(run.trials["detector"] == "tiny") & (run.trials["status"] == "finished")]
    savings = promotion.savings(group)
    assert savings["surrogates"] == pytest.approx(40 * 0.05)
    assert savings["short"] == pytest.approx(rows.loc[rows[EPOCHS] == SHORT, "seconds"].sum())
    assert savings["spent"] == pytest.approx(rows["seconds"].sum() + 2)
    assert savings["without"] == pytest.approx(full.mean() * 40 * 2 + 2)
    assert savings["saved"] == pytest.approx(savings["without"] - savings["spent"])


def test_agreement_with_the_full_training_by_hand(group):
    table, ranks = promotion.stages(group), promotion.stage_ranks(group)
    assert table["n"].tolist()[:2] == [3, 3]
    assert table.iloc[2][["n", "spearman", "first", "regret"]].isna().all()
    for i, row in enumerate(table.to_dict("records")[:2]):
        both = ranks.iloc[:, [i, 2]].dropna()
        assert row["spearman"] == pytest.approx(both.corr("spearman").iloc[0, 1])
        assert row["kendall"] == pytest.approx(both.corr("kendall").iloc[0, 1])
        best = both.iloc[:, 1].idxmin()
        assert row["best_rank"] == both.iloc[:, 0][best]
        assert row["first"] == both.iloc[:, 0].idxmin()
        assert row["regret"] == pytest.approx(group.ap[best] - group.ap[row["first"]])
        assert row["regret"] >= 0
        assert row["spearman_p"] >= 2 / np.prod(range(1, len(both) + 1)) - 1e-12
    assert table["ranked"].tolist()[:2] == [40, 8]


def test_many_placements_have_p_values_too(tmp_path):
    run = RunFolder.read(_write_promotion(tmp_path / "many", kept=(20, 10), seeds=(1,)))
    table = promotion.stages(next(promotion.promoted(run))).iloc[:2]
    assert table["n"].tolist() == [10, 10]
    assert table["spearman_p"].between(0, 1).all()


def test_a_placement_without_a_value_has_no_rank(run):
    promotions = run.promotions.copy()
    lost = promotions.query("detector == 'tiny' and rung == 1 and rank == 8").index
    promotions.loc[lost, "value"] = np.nan
    group = next(promotion.promoted(replace(run, promotions=promotions)))
    assert promotion.stage_ranks(group)[1].notna().sum() == 7
    table = promotion.stages(group)
    assert table["without_value"].tolist() == [0, 1, 0]
    assert table["n"].tolist()[:2] == [3, 3]
    assert table["ranked"].tolist()[:2] == [40, 7]


def test_equal_full_trainings_judge_no_rung(run):
    results = run.results.copy()
    results.loc[results[EPOCHS] == FULL, "value"] = 0.0
    section = promotion_section(Analysis(replace(run, results=results)))
    assert sum("Several full trainings are equally best" in note for note in section.notes) == 2
    assert not any("was ranked" in note for note in section.notes)


def test_short_trainings_are_told_by_what_their_rung_sets():
    trials = pd.DataFrame(
        {"detector": "a", EPOCHS: [2, 10, 10, 10], "training.flip_y": [False, True, True, False]}
    )
    axes = [EPOCHS, "training.flip_y"]
    changes = ({}, {"training.flip_y": False})
    rungs = [Rung(by="s_mig", keep=2, set=change) for change in changes]
    assert promotion.is_full(trials, axes, rungs).tolist() == [False, True, True, False]
    assert promotion.is_full(trials, axes[:1]).tolist() == [False, True, True, True]


def test_nothing_is_estimated_when_no_full_training_finished(run):
    trials = run.trials.copy()
    full = trials[EPOCHS] == FULL
    trials.loc[full & (trials["status"] == "finished"), ["status", "error"]] = "failed", "no memory"
    less = replace(run, trials=trials, results=run.results[run.results[EPOCHS] == SHORT])
    groups = list(promotion.promoted(less))
    assert [len(group.ap) for group in groups] == [0, 0]
    assert np.isnan(promotion.savings(groups[0])["without"])
    assert promotion.stages(groups[0])["n"].isna().all()
    section = promotion_section(Analysis(less))
    assert any("No full training finished" in note for note in section.notes)


def test_the_report_tells_what_was_saved_and_risked(run, group, folder):
    page = report_of(folder, "promotion", "placements").read_text(encoding="utf-8")
    row = promotion.savings(group)
    share = 100 * row["saved"] / row["without"]
    assert f"tiny: Promotion spent {row['spent']:,.0f} s (" in page
    assert f"), {share:.0f} % less than the {row['without']:,.0f} s" in page
    pruned = (run.trials["status"] == "pruned").sum()
    assert f"{len(run.trials)} trials, {pruned} of them pruned by promotion" in page
    assert "did not finish" not in page
    assert "Only a full training shows whether a pruned placement would have been best" in page
    assert "agreement with the full training · second" in page
    # Other placements are compared after the full training alone.
    assert "second, epochs = 10" in page
    assert "second, epochs = 2" not in page
