"""Sections of a sweep with several detectors and densities."""

import re
from dataclasses import replace

import pytest

from tests.tracking.made_up_run import NAMES, report_of, write_run
from tracking.labels import points
from tracking.pages.section import Section
from tracking.report.analysis import Analysis
from tracking.report.sections.ablations import density_section
from tracking.report.sections.predictors import MOST_SENTENCES, predictors_section
from tracking.report.sections.published import add_published_surrogates, published_density_table
from tracking.report.sections.sensitivity import sensitivity_section
from tracking.run_folders.sweep import RunFolder


@pytest.fixture(scope="module")
def analysis(tmp_path_factory) -> Analysis:
    path = tmp_path_factory.mktemp("groups") / "run"
    folder = write_run(path, detectors=("second", "pointpillars"), densities=(40, 120))
    run = RunFolder.read(folder)
    values = run.surrogates["value"] * run.surrogates["scene.density"] / 40
    of_headlines = "metric in ('AP_R40_3D', 'recall')"  # other metrics are in no test here
    parts = {name: getattr(run, name).query(of_headlines) for name in ("results", "left_out")}
    return Analysis(replace(run, surrogates=run.surrogates.assign(value=values), **parts))


def test_of_many_findings_the_first_are_listed(analysis):
    section = predictors_section(analysis)
    assert f"The first {MOST_SENTENCES} of 12 cases; the table has all." in section.notes
    # 5 placements: a perfect order has p = 2 / 5!, times the tests.
    tests = int(analysis.correlations["spearman_tests"].iloc[0])
    sentence = (
        f" With 5 placements and {tests} tests not even a perfect order would be significant."
    )
    assert all(note.endswith(sentence) for note in section.notes[:MOST_SENTENCES])
    assert len({row[1] for row in section.tables[0].rows}) == 4


def test_the_first_screen_has_the_answer_the_picture_then_all_verdicts(tmp_path):
    both, three = ("second", "pointpillars"), (40, 80, 120)
    folder = write_run(tmp_path / "run", NAMES[:3], (1,), detectors=both, densities=three)
    page = report_of(folder, "best", "sensitivity").read_text(encoding="utf-8")
    first = page[: page.index("<nav")]
    parts = ['<div class="card answer">', '<div class="plot"', 'class="table verdicts tall"']
    assert sorted(map(first.index, parts)) == [first.index(part) for part in parts]
    assert [first.count(part) for part in parts] == [1, 1, 1]
    assert first.count("Highest mean for Car · ") == 6
    # On paper a table that is cut says so; the verdicts, which are in no CSV file, never are.
    tables = re.findall(r'class="table (?:few|wide)(?: tall)?( cut)?"(.*?)</table>', page, re.S)
    assert {bool(cut) for cut, _ in tables} == {True, False}
    for cut, body in tables:
        assert bool(cut) == (body.count("<tr>") - 1 > 24)


def test_a_few_findings_name_detector_and_setting(analysis):
    results = analysis.run.results
    few = replace(analysis.run, results=results[results["detector"] == "second"])
    cars = [note for note in predictors_section(Analysis(few)).notes if "Car, 3D AP" in note]
    assert len(cars) == 2 <= MOST_SENTENCES
    assert [note.split(" · ")[0] for note in cars] == ["density = 40", "density = 120"]


def test_the_most_sensitive_is_named_with_its_setting(analysis):
    (sentence,) = (note for note in sensitivity_section(analysis).notes if note.startswith("Car: "))
    assert "the most of 4 detectors and settings" in sentence
    assert "density = " in sentence


def test_density_has_a_column_for_each_and_the_papers_own(analysis):
    section = density_section(analysis)
    car = [t for t in section.tables if t.caption.startswith("Car · 3D AP @ 0.7 (%) · ")]
    assert [t.caption.rsplit(" ", 1)[1] for t in car] == ["second", "pointpillars"]
    assert car[0].head == ("placement", "density 40", "density 120", "change (points)")
    densities = car[0].data.query("placement == 'line'").set_index("scene.density")["mean (%)"]
    row = next(row for row in car[0].rows if row[0] == "line")
    assert row[-1] == points(densities[120] - densities[40])
    assert "published-density" in [table.name for table in section.tables]


def test_the_papers_own_surrogates_meet_its_own_ap():
    section = Section("published")
    add_published_surrogates(section)
    table = section.tables[0].data
    rows = table.query("over == 'placements' and metric == 'AP_R40_3D' and detector == 'pv_rcnn'")
    # Five pairs (S-MIG, AP): ranks 5 2 4 1 3 against 4 3 5 2 1.
    assert rows.iloc[0][["n", "spearman"]].tolist() == [5, pytest.approx(0.6)]
    dense = table[table["over"] == "densities"]
    assert set(dense["surrogate"]) == {"s_mig", "h_pog", "ig"}
    assert dense["spearman_p"].min() == pytest.approx(1 / 3)


def test_the_published_density_table_has_ap_and_surrogates_from_sparse_to_dense():
    table = published_density_table()
    assert table.head == ("", "sparse", "medium", "dense")
    assert ("pv_rcnn · 3D AP @ 0.7 (%)", "54.48", "56.88", "57.98") in table.rows
    assert len(table.rows) == 7
