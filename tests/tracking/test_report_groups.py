"""Sections of a sweep with several detectors and densities."""

import re
from dataclasses import replace

import pandas as pd
import pytest
from made_up_run import NAMES, report_of, write_run

from tracking.findings.correlation import correlate
from tracking.pages.section import Section
from tracking.report.analysis import Analysis
from tracking.report.sections.density import density_section
from tracking.report.sections.detectors import detectors_section
from tracking.report.sections.predictors import MOST_SENTENCES, counted, predictors_section
from tracking.report.sections.published import add_published_surrogates, published_density_table
from tracking.run_folders.sweep import RunFolder


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> RunFolder:
    folder = write_run(
        tmp_path_factory.mktemp("groups") / "run",
        detectors=("second", "pointpillars"),
        densities=(40, 80, 120),
    )
    table = pd.read_parquet(folder / "surrogates.parquet")
    table["value"] *= table["scene.density"] / 40
    table.to_parquet(folder / "surrogates.parquet", index=False)
    return RunFolder.read(folder)


def predictors(run: RunFolder) -> Section:
    section = predictors_section(Analysis(run))
    assert section is not None
    return section


def test_many_findings_are_counted_and_a_legend_stays_short(run):
    section = predictors(run)
    assert "of 18 cases" in section.notes[0]
    # 5 placements: a perfect order has p = 2 / 5!, times the tests.
    tests = int(correlate(run.results, run.surrogates, run.axes)["spearman_tests"].iloc[0])
    said = f" With 5 placements and {tests} tests not even a perfect order could be shown."
    assert section.notes[0].endswith(said)
    assert not any("second" in note for note in section.notes)
    for plot in section.figures:
        assert sum(bool(trace.showlegend) for trace in plot.data) <= 8
    rows = {str(label) for label in section.figures[1].data[0].y}
    assert len(rows) == 6
    assert all(label.startswith("3D AP @ 0.7<br>") for label in rows)
    shown = {cell for row in section.figures[0].data[0].text for cell in row}
    assert not any("<" in cell for cell in shown), "plotly counts the letters of tags too"


def test_it_is_counted_in_how_many_cases_nothing_could_be_shown(run):
    own = Analysis(run)
    enough = own.correlations.assign(n=8, spearman_tests=100)
    assert "perfect order" not in counted(run, own.predicted, enough)
    some = enough.assign(n=enough["n"].mask(enough["detector"] == "second", 4))
    said = " With 4 placements and 100 tests in 9 of them not even a perfect order could be shown."
    assert counted(run, own.predicted, some).endswith(said)


def test_more_verdicts_than_cards_keep_their_finding_on_the_first_screen(tmp_path):
    both, three = ("second", "pointpillars"), (40, 80, 120)
    folder = write_run(tmp_path / "run", NAMES[:3], (1,), detectors=both, densities=three)
    page = report_of(folder, "predictors", "correlation").read_text(encoding="utf-8")
    first = page[: page.index("<nav")]
    assert '<div class="card">' not in first
    assert "of 18 cases" in first
    # On paper a table that is cut says so; the verdicts, which are in no CSV file, never are.
    assert 'class="table verdicts tall"' in first
    found = re.findall(r'class="table (?:few|wide)(?: tall)?( cut)?"(.*?)</table>', page, re.S)
    assert {bool(cut) for cut, _ in found} == {True, False}
    for cut, body in found:
        assert bool(cut) == (body.count("<tr>") - 1 > 24)
    assert "not even a perfect order could be shown." in first


def test_a_few_findings_name_detector_and_setting(run):
    few = run.results[run.results["detector"] == "second"]
    few = few[few["scene.density"] != 80]
    notes = predictors(replace(run, results=few)).notes
    cars = [note for note in notes if "Car, 3D AP" in note]
    assert len(cars) == 2 <= MOST_SENTENCES
    assert [note.split(" · ")[0] for note in cars] == ["density = 40", "density = 120"]


def test_the_most_sensitive_is_named_with_its_setting(run):
    section = detectors_section(Analysis(run))
    (said,) = (note for note in section.notes if note.startswith("Car: "))
    assert "the most of 6 detectors and settings" in said
    assert "density = " in said


def test_surrogates_by_density_are_in_the_order_of_the_sweep(run):
    section = density_section(Analysis(run))
    (table,) = (t for t in section.tables if t.caption == "Car · surrogates by density")
    assert [row[1] for row in table.rows[: len(NAMES)]] == list(NAMES)
    assert "published-density" in [table.name for table in section.tables]
    assert [len(line.x) for line in section.figures[0].data] == [3] * len(NAMES)


def test_the_papers_own_surrogates_meet_its_own_ap():
    section = Section("published")
    add_published_surrogates(section)
    assert len(section.figures) == 2
    first, second = section.figures
    assert (len(first.data[0].x), len(second.data[0].x)) == (5, 3)
    table = section.tables[0].data
    own = table.query(
        "over == 'placements' and metric == 'AP_R40_3D' and detector == 'pv_rcnn'"
    ).iloc[0]
    # Five pairs (S-MIG, AP): ranks 5 2 4 1 3 against 4 3 5 2 1.
    assert (own["n"], own["spearman"]) == (5, pytest.approx(0.6))
    dense = table[table["over"] == "densities"]
    assert set(dense["surrogate"]) == {"s_mig", "h_pog", "ig"}
    assert dense["spearman_p"].min() == pytest.approx(1 / 3)
    assert f"p = {own['spearman_p']:.2g}" in first.data[0].name


def test_the_labels_of_published_placements_move_with_the_menu():
    section = Section("published")
    add_published_surrogates(section)
    plot = section.figures[1]  # Square at three densities, which has three surrogates
    for button in plot.layout.updatemenus[0].buttons:
        traces, layout = button.args
        places = dict(zip(traces["text"][0], traces["x"][0], strict=True))
        assert {note["text"]: note["x"] for note in layout["annotations"]} == places
        assert sorted(line["x0"] for line in layout["shapes"]) == sorted(places.values())
    first = plot.layout.updatemenus[0].buttons[0].args[1]
    assert [note.x for note in plot.layout.annotations] == [n["x"] for n in first["annotations"]]


def test_the_published_density_table_has_ap_and_surrogates_from_sparse_to_dense():
    table = published_density_table()
    assert table.head == ("", "sparse", "medium", "dense")
    assert ("pv_rcnn · 3D AP @ 0.7 (%)", "54.48", "56.88", "57.98") in table.rows
    assert len(table.rows) == 7
