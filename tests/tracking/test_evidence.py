"""Claims of a headline: weaknesses of the evidence, and what to run against them."""

import json
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from sweeps.configuration.grid import read_sweep
from tests.tracking.made_up_run import report_of, write_run
from tests.tracking.test_report import Page
from tracking.findings import evidence
from tracking.findings.groups import groups
from tracking.report.analysis import Analysis
from tracking.report.cautions import cautions
from tracking.run_folders.sweep import RunFolder
from tracking.statistics.jackknife import LEAST_ROUTES

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("evidence") / "grid"
    return RunFolder.read(write_run(folder, ("a", "b", "c"), (1, 2, 3), enough=True))


def seeds(run, number):
    return replace(run, results=run.results[run.results["seed"] <= number])


def routes(run, number):
    table = run.individuals.assign(route=run.individuals["route"] % number)
    return replace(run, individuals=table)


def individuals(run, number):
    table = run.individuals
    return replace(run, individuals=table[table.groupby(["split", "class"]).cumcount() < number])


def short(run, share):
    loss = (run.curves["metric"] == "loss") & (run.curves["epoch"] == run.curves["epoch"].max())
    value = run.curves["value"] * np.where(loss, 1 - share, 1.0)
    return replace(run, curves=run.curves.assign(value=value))


def one_short(run, share):
    others = run.curves["trial"] != run.trials["trial"].iloc[0]
    return replace(run, curves=run.curves.where(others, short(run, share).curves))


def ap(run, most):
    is_ap = run.results["metric"] == "AP_R40_3D"
    value = np.where(is_ap, most * run.results["value"] / 100, run.results["value"])
    return replace(run, results=run.results.assign(value=value))


LEARNED = "a detector that learned little (3D AP @ 0.7 of Car is"
FELL = "a short training (the last epoch still lowered the loss by 20 %"
ONE_FELL = "a short training (the last epoch of 1 of 9 trials still lowered the loss by 20 %"
MET = "only 30 individuals in the test frames (at least 100)"
WEAK = {
    "seeds": (seeds, 2, "only 2 seeds (at least 3)", "grid.seed=[1,2,3]"),
    "routes": (routes, 1, "only 1 test route (at least 4)", "scene.test_routes=8"),
    "individuals": (individuals, 15, MET, "scene.test_routes=27"),
    "training": (short, 0.2, FELL, "training."),
    "a training": (one_short, 0.2, ONE_FELL, "training."),
    "learned": (ap, 3, LEARNED, "training.epochs="),
}


def test_enough_evidence_has_no_weakness(run):
    (group,) = groups(run)
    assert evidence.weaknesses(run, group) == []
    answer = Analysis(run).answer
    assert (answer.grade, answer.command, answer.enough) == ("Recommended", "", True)
    assert "likely to be the best" in answer.certainty


def test_of_equal_rigs_none_is_ahead(run):
    best = Analysis(run).answer.best
    other = "a" if best != "a" else "b"

    def twins(table):
        of_best = table[table["placement"] == best]
        return pd.concat([table[table["placement"] != other], of_best.assign(placement=other)])

    equal = replace(run, results=twins(run.results), left_out=twins(run.left_out))
    answer = Analysis(equal).answer
    assert answer.grade == "No rig is ahead of these"
    assert set(answer.best.split(", ")) == {best, other}


@pytest.mark.parametrize("kind", WEAK)
def test_each_weakness_takes_the_headline_back_and_names_what_to_run(run, kind):
    change, value, clause, wanted = WEAK[kind]
    answer = Analysis(change(run, value)).answer
    assert answer.grade == "Not enough evidence to recommend a rig"
    assert answer.certainty.lower().startswith(clause.lower())
    assert "likely" not in " ".join([answer.certainty, *answer.leads])
    assert all(
        "likely" not in other.certainty for other in answer.other_classes if other.weaknesses
    )
    assert answer.command.startswith(f"{run.sweep.command} --set ")
    pairs = [word for word in shlex.split(answer.command) if "=" in word]
    assert any(pair.startswith(wanted) for pair in pairs)
    read_sweep(EXAMPLES / "grid.yaml", pairs)  # raises what it does not take


LIMITS = [(routes, LEAST_ROUTES, LEAST_ROUTES - 1), (short, 0.049, 0.051), (ap, 30, 5)]
LIMITS += [(seeds, evidence.LEAST_SEEDS, evidence.LEAST_SEEDS - 1)]
LIMITS += [(individuals, evidence.LEAST_INDIVIDUALS, evidence.LEAST_INDIVIDUALS // 2 - 1)]


@pytest.mark.parametrize(("change", "enough", "few"), LIMITS)
def test_the_limits_are_the_named_ones(run, change, enough, few):
    assert Analysis(change(run, enough)).answer.enough
    assert not Analysis(change(run, few)).answer.enough


def test_the_two_that_weigh_most_are_named_and_all_are_listed_and_removed(run):
    weak = short(individuals(routes(seeds(run, 2), 2), 20), 0.4)  # 1.5, 2, 2.5 and 8 times short
    answer = Analysis(weak).answer
    assert answer.certainty == (
        "A short training (the last epoch still lowered the loss by 40 %) and "
        "only 40 individuals in the test frames (at least 100)."
    )
    assert all(key in answer.command for key in ("grid.seed", "test_routes", "training.epochs"))
    listed = cautions(Analysis(weak))
    for part in ("Training was short", "Car: ", "Fewer than 4 test routes", "Two seeds"):
        assert any(text.startswith(part) for text in listed), part


def test_a_remedy_sets_an_axis_where_the_key_is_one_and_nothing_for_a_log(run):
    named = replace(short(routes(run, 1), 0.2), axes=("training.epochs",))
    log = replace(named, config="scene: {source: log, folder: drives}")
    (group,) = groups(run)
    weaknesses = evidence.weaknesses(log, group)
    assert evidence.remedy("run", weaknesses) == "run --set 'grid.training.epochs=[20]'"
    assert any("scene.test_folder" in weakness.sentence for weakness in weaknesses)
    assert evidence.remedy("run", []) == ""


@pytest.mark.parametrize(("evaluator", "seeded"), [("command", False), ("specialist", True)])
def test_only_a_command_without_a_seed_is_not_given_seeds(run, evaluator, seeded):
    command = "{command: 'detect {train} {test}'}"
    sweep = run.sweep.model_copy(update={"evaluator": evaluator})
    for config in (f"evaluator: {command}", f"grid: {{evaluator: [specialist, {command}]}}"):
        few = Analysis(replace(seeds(run, 1), config=config, sweep=sweep))
        assert ("grid.seed" in few.answer.command) == seeded
        assert any("{seed}" in text for text in cautions(few)) != seeded


def test_a_sweep_without_results_has_no_headline(run):
    assert Analysis(replace(run, results=run.results[:0])).headline == []
    assert Analysis(replace(run, results=run.results.assign(value=np.nan))).headline == []


def test_no_left_out_table_is_a_weakness(run):
    answer = Analysis(replace(run, left_out=None)).answer
    assert answer.certainty.startswith("Intervals over seeds alone")


def test_generalists_are_seeds(run):
    (one,) = evidence.few_seeds({"a": {4}, "b": {4}}, True, "search.seeds")
    assert one.clause == "only 1 generalist (at least 3)"
    assert one.remedy == {"search.seeds": [4, 5, 6]}
    assert evidence.few_seeds({"a": {1, 2, 3}}, True, "search.seeds") == []
    (some,) = evidence.few_seeds({"a": {1}, "b": {1, 2, 3}}, False, "grid.seed")
    assert some.sentence.startswith("One seed only for a: ")
    assert evidence.grade([one, some]) == "Not enough evidence: only 1 generalist (at least 3)."


def test_no_page_is_surer_than_the_weakest_link(run, tmp_path):
    """Two seeds, two epochs, one route, 31 individuals: nothing bold may say how likely."""
    folder = write_run(tmp_path / "weak", ("a", "b", "c"), (1, 2))
    table = pd.read_parquet(folder / "individuals.parquet").assign(route=0)
    table.to_parquet(folder / "individuals.parquet")
    report_of(folder, "best", "failures")
    for name in ("report.html", "decision.html"):
        page = Page((folder / name).read_text(encoding="utf-8"))
        assert "Not enough evidence to recommend a rig" in page.text
        assert page.text.count("ot enough evidence") == 1
        assert "A short training" in page.text
        assert "Reasons for doubt: " in page.text
        first = page.text[: page.text.index("Reasons for doubt")]
        assert "likely to be the best" not in first
        assert "be the best" not in json.dumps(page.figures[0])
        assert "Recommended" not in first
        assert "--set 'grid.seed=[1,2,3]'" in first
    terminal = Analysis(RunFolder.read(folder)).headline
    assert terminal[-1].startswith("Not enough evidence to recommend a rig: ")
    assert ". A short training" in terminal[-2]
    assert terminal[0].startswith("For more evidence, run: lidarplace run ")
    markdown = (folder / "report.md").read_text(encoding="utf-8")
    assert "--set 'grid.seed=[1,2,3]'" in markdown
    assert "Reasons for doubt: " in markdown
