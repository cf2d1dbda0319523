"""Files beside a report (Markdown, CSV) and the limit of the page."""

import re

import numpy as np
import pandas as pd
import pytest

from tests.tracking.made_up_run import NAMES
from tests.tracking.test_report import Page
from tracking.figures.kit.style import figure
from tracking.pages.html_page import SECTIONS_ALONE, write_csv_files, write_page
from tracking.pages.section import Section, Table, figure_title, slug


def test_every_linked_csv_file_is_there_and_no_other(reported_run):
    links = Page((reported_run / "report.html").read_text(encoding="utf-8")).links
    linked = {link for link in links if not link.startswith("#")}
    files = {f"tables/{file.name}" for file in (reported_run / "tables").glob("*.csv")}
    assert linked == {"decision.html", "failures.html", *files}
    assert (reported_run / "tables" / "mine.txt").is_file()
    assert "tables/placements-car.csv" in linked


def test_every_entry_of_the_contents_has_its_section(reported_run):
    text = (reported_run / "report.html").read_text(encoding="utf-8")
    anchors = [link[1:] for link in Page(text).links if link.startswith("#")]
    assert len(anchors) > 8
    assert all(text.count(f'id="{anchor}"') == 1 for anchor in anchors)


def test_csv_files_hold_unrounded_numbers(reported_run):
    table = pd.read_csv(reported_run / "tables" / "placements-car.csv").set_index("placement")
    results = pd.read_parquet(reported_run / "results.parquet")
    rows = results.query("`class` == 'Car' and metric == 'AP_R40_3D' and iou == 0.7")
    means = rows.groupby("placement")["value"].mean()
    assert set(table.index) == set(NAMES)
    for name in NAMES:
        assert table.loc[name, "3D AP @ 0.7 (%) mean"] == pytest.approx(means[name], rel=1e-12)
    assert "S-MIG (nats)" in table.columns


def test_markdown_has_every_table_of_the_page(reported_run):
    text = (reported_run / "report.md").read_text(encoding="utf-8")
    page = Page((reported_run / "report.html").read_text(encoding="utf-8"))
    # The verdicts are paragraphs there.
    assert len(re.findall(r"^\| :?---", text, re.M)) == page.tags.count("table") - 1
    assert text.startswith("# grid\n")
    assert "**Highest mean for Car" in text
    assert "pyramid \\<b\\>\\&amp;" in text
    for line in re.findall(r"^\|.*\|$", text, re.M):
        assert "\n" not in line


def test_markdown_has_pictures_beside_it(reported_run):
    text = (reported_run / "report.md").read_text(encoding="utf-8")
    pictures = re.findall(r"^!\[[a-z-]+\]\((figures/[a-z-]+\.png)\)$", text, re.M)
    sizes = {path: (reported_run / path).stat().st_size for path in pictures}
    assert {"figures/correlations.png", "figures/s-mig-against-metrics.png"} < set(sizes)
    assert {"figures/placements.png", "figures/clouds.png"} < set(sizes)
    assert 0 < max(sizes.values()) < 300_000


def test_markdown_tells_how_much_was_compared_as_the_page_does(reported_run):
    many = "400 training and 100 test frames with 840 boxes of 68 individuals."
    extent = f"5 placements, 10 trials, {many}"
    assert (reported_run / "report.md").read_text().split("\n\n")[1] == extent
    assert f">{extent}<" in (reported_run / "report.html").read_text()


def test_figures_are_named_for_those_who_do_not_see_them(reported_run):
    text = (reported_run / "report.html").read_text(encoding="utf-8")
    labels = re.findall(r'role="figure" aria-label="([^"]*)"', text)
    assert len(labels) == len(Page(text).figures)
    assert all(labels)


def test_a_page_that_would_be_too_large_leaves_its_heaviest_figures_out(
    tmp_path, monkeypatch, capsys
):
    plots = [figure(name, 300).add_scatter(y=np.arange(n)) for name, n in (("a", 9), ("b", 99_999))]
    section, target = Section("s", figures=plots), tmp_path / "page.html"

    def write():
        return write_page(target, SECTIONS_ALONE, [section], name="n").stat().st_size

    whole = write()
    monkeypatch.setattr("tracking.pages.html_page.LARGEST_PAGE", whole - 50_000)
    assert write() <= whole - 50_000
    assert [figure_title(plot) for plot in section.figures] == ["a"]
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert "left out to stay below" in message
    assert "Left out, so that the page stays below" in Page(target.read_text("utf-8")).text


def test_two_tables_of_one_name_get_a_file_each(tmp_path):
    data = pd.DataFrame({"a": [1.0]})
    tables = [Table("t", ("a",), (("1",),), name="t", data=data) for _ in range(2)]
    section = Section("s", tables=[*tables, Table("words", ("a",), (("b",),))])
    write_csv_files(tmp_path / "tables", [section])
    assert [table.name for table in section.tables] == ["t", "t-2", ""]
    assert sorted(file.name for file in (tmp_path / "tables").iterdir()) == ["t-2.csv", "t.csv"]


def test_a_slug_is_a_safe_name():
    assert slug("placements", "Car", "a/../b") == "placements-car-a-..-b"
    assert (slug("../../x"), slug("ρ Pedestrian é")) == ("x", "pedestrian-e")


def test_columns_full_of_dashes_are_left_out_and_stressed_cells_move_along():
    rows = (("a", "–", "1", "–"), ("b", "–", "–", "–"))
    stressed = frozenset({(0, 2), (1, 1)})
    table = Table("t", ("rig", "sd", "mean", "p"), rows, stressed, frozenset({0})).without_dashes()
    assert table.head == ("rig", "mean")
    assert table.rows == (("a", "1"), ("b", "–"))
    assert table.best == {(0, 1)}
    assert table.words == {0}
    empty = Table("t", ("rig", "sd"), ())
    assert empty.without_dashes() == empty


def test_all_but_the_answer_is_folded_away_with_its_figures_and_tables(reported_run):
    text = (reported_run / "report.html").read_text(encoding="utf-8")
    fold = r'<details class="folded"><summary><h2[^>]*>([^<]*)<(.*?)</details>'
    folds = dict(re.findall(fold, text, re.S))
    headings = re.findall(r"<h2[^>]*>([^<]*)<", text)
    first = ["Which surrogate predicts AP and recall?", "Which placement is best?"]
    assert headings == [*first, *folds]
    inside = folds["Can a surrogate be trusted?"]
    assert "<table>" in inside
    assert "application/json" in inside
