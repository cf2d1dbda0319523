"""The first screen of a report: verdicts and cautions."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from tests.tracking.made_up_run import write_run
from tracking.findings.groups import groups
from tracking.report.analysis import Analysis
from tracking.report.cautions import cautions
from tracking.report.headline import surrogate_statements
from tracking.report.recommendation import Recommendation
from tracking.run_folders.sweep import RunFolder
from tracking.run_folders.sweep_json import Frames


def first_screen(run):
    (group,) = groups(run)
    return list(Recommendation(run, group).statements.values())


def with_values(run, values, metric="AP_R40_3D", object_class="Car"):
    """The run with these values of a metric: placement -> one a seed."""
    results = run.results.copy()
    match = (results["metric"] == metric) & (results["class"] == object_class)
    for name, seeds in values.items():
        for seed, value in enumerate(seeds, start=1):
            rows = match & (results["placement"] == name) & (results["seed"] == seed)
            assert rows.any()
            results.loc[rows, "value"] = value
    return replace(run, results=results)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    names = ("a", "b", "c", "d")
    folder = tmp_path_factory.mktemp("runs") / "grid"
    return RunFolder.read(write_run(folder, names, (1, 2, 3), enough=True))


def test_a_clear_winner_is_told_apart(run):
    values = {"a": (90, 91, 92), "b": (50, 51, 52), "c": (40, 41, 42), "d": (30, 31, 32)}
    car = first_screen(with_values(run, values))[0]
    assert (car.title, car.best) == ("Best for Car", "a")
    assert car.lead.startswith("91.0 %, 40.0 points ahead of b (95 % CI 3")
    sure = "over 99 % likely to be the best of 4, and significantly better than all others."
    assert car.certainty == sure


def test_a_lead_within_the_scatter_of_seeds_is_not(run):
    values = {"a": (90, 60, 75), "b": (88, 61, 70), "c": (10, 30, 20), "d": (0, 10, 5)}
    car = first_screen(with_values(run, values))[0]
    assert "; not significantly better than b." in car.certainty
    assert 50 < float(car.certainty.split(" %")[0]) < 80


def test_one_seed_says_that_it_cannot_be_told(tmp_path):
    run = RunFolder.read(write_run(tmp_path / "one", ("a", "b", "c"), (1,)))
    car = first_screen(run)[0]
    assert car.certainty.startswith("Not enough evidence: ")
    assert "only 1 seed (at least 3)" in car.certainty
    assert car.title == "Highest mean for Car"
    assert "95 %" not in car.lead
    assert any("One seed" in sentence for sentence in cautions(Analysis(run)))


def test_recall_of_all_has_a_verdict_and_a_class_without_objects_has_none(run):
    names = [statement.title for statement in first_screen(run)]
    assert names == ["Best for Car", "Best for Pedestrian", "Best for all objects"]


def test_cautions_of_failures_objects_and_training(run):
    trials = run.trials.copy()
    trials.loc[0, ["status", "error"]] = "failed", "Traceback\nValueError: no frame"
    columns = ["trial", "epoch", "metric", "value"]
    rows = [(t, e, "loss", 1 / e) for t in trials["trial"] for e in (1, 2, 3)]
    texts = cautions(
        Analysis(replace(run, trials=trials, curves=pd.DataFrame(rows, columns=columns)))
    )
    assert texts[0] == "1 of 12 trials did not finish. The first error: ValueError: no frame"
    assert any("Only 4 placements: no two-sided p-value can be below 0.083." in s for s in texts)
    assert any(s.startswith("Cyclist: no ground truth") for s in texts)
    short = "in 12 of 12 trials the last epoch still lowered the loss by more than 5 %"
    assert any(short in s for s in texts)


def test_what_was_learned_is_judged_by_the_metric_of_the_headline(run):
    results = run.results.copy()
    strict = (results["metric"] == "AP_R40_3D") & (results["iou"] == 0.7)
    results.loc[strict, "value"] = 0.3  # at IoU 0.5 it stays far above
    sentences = cautions(Analysis(replace(run, results=results)))
    wanted = "Car: 3D AP @ 0.7 is below 5 % everywhere: the detector learned too little."
    assert [s for s in sentences if "learned too little" in s] == [wanted]
    loose = run.results.copy()
    loose.loc[loose["metric"] == "AP_R40_BEV", "value"] = 0.3
    sentences = cautions(Analysis(replace(run, results=loose)))
    assert not any("learned too little" in s for s in sentences)


@pytest.mark.parametrize(("share", "said"), [(0.86, True), (0.67, True), (0.66, False)])
def test_expected_ig_that_counts_rays_is_a_caution(run, share, said):
    rows = run.surrogates
    table = rows.assign(linear_share=np.where(rows["surrogate"] == "expected_ig", share, np.nan))
    for results in (run.results, run.results[:0]):
        sentences = cautions(Analysis(replace(run, surrogates=table, results=results)))
        assert any("counts rays" in text for text in sentences) == said
    # Older run folders do not know.
    assert not any("counts rays" in text for text in cautions(Analysis(run)))


def test_few_frames_are_a_caution(run):
    few = {(4, 100): ["Only 4 training frames"], (400, 1): ["Only 1 test frame"], (20, 20): []}
    few[19, 19] = ["Only 19 training frames", "Only 19 test frames"]
    for frames, sentences in few.items():
        starts = [text.split(":")[0] for text in cautions(Analysis(of_frames(run, *frames)))]
        assert [start for start in starts if "frame" in start] == sentences


def of_frames(run, train, test):
    frames = Frames(train=train, test=test)
    return replace(run, sweep=run.sweep.model_copy(update={"frames": frames}))


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "alone"
    return RunFolder.read(write_run(folder, ("a", "b", "c"), detectors=()))


def test_surrogates_of_few_frames_are_a_caution(alone):
    assert not [s for s in cautions(Analysis(of_frames(alone, 10, 0))) if "frame" in s]
    (sentence,) = (s for s in cautions(Analysis(of_frames(alone, 4, 0))) if "frame" in s)
    assert sentence.startswith("The surrogates use only 4 frames: ")


def test_equal_surrogates_have_no_winner(alone):
    def with_gain(values, **others):
        table = alone.surrogates[alone.surrogates["class"] == "Car"].copy()
        for name, gains in ({"expected_recall": values} | others).items():
            table.loc[table["surrogate"] == name, "value"] = gains
        changed = replace(alone, surrogates=table)
        (group,) = groups(changed)
        return surrogate_statements(changed, group)[0]

    empty = with_gain(0.0, h_pog=0.0)
    assert empty.best == "no placement is ahead"
    assert empty.lead == "0 of the objects for all 3 placements"
    assert empty.certainty == "H_POG is 0: no Car was seen, or always in the same voxels."
    level = with_gain([0.7, 0.7 + 1e-15, 0.7])
    assert (level.best, level.certainty) == ("no placement is ahead", "")
    ahead = with_gain([0.7, 0.77, 0.7])
    lead = "0.77 of the objects, 10 % ahead of a, of 3 placements"
    assert (ahead.best, ahead.lead) == ("b", lead)


def test_a_training_that_ended_flat_is_no_caution(run):
    flat = run.curves.assign(value=np.where(run.curves["metric"] == "loss", 0.5, 1.0))
    sentences = cautions(Analysis(replace(run, curves=flat)))
    assert not any("Training was short" in s for s in sentences)
    assert cautions(Analysis(replace(run, curves=flat[flat["epoch"] == 1]))) == sentences
