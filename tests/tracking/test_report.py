"""The report of a made-up run."""

import html
import json
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from tests.tracking.made_up_run import NAMES, report_of, write_run
from tracking.findings.surrogate_accuracy import relative_errors, summarise
from tracking.labels import surrogate_name
from tracking.report.analysis import Analysis
from tracking.report.build import build_report
from tracking.report.command import app
from tracking.report.sections.accuracy import accuracy_section
from tracking.report.sections.coefficient_map import coefficient_map_section
from tracking.report.sections.predictors import predictors_section
from tracking.report.sections.where_time_went import stage_times, where_time_went
from tracking.run_folders.sweep import RunFolder

VOID = {"meta", "link", "img", "br", "hr", "input", "base", "source"}


class Page(HTMLParser):
    """Parts of a page that a browser would load, show, and read as figures."""

    def __init__(self, source: str) -> None:
        super().__init__()
        self.loads, self.links, self.words, self.tags, self.csp = [], [], [], [], ""
        self.scripts: list[tuple[dict[str, str | None], str]] = []
        self._inside, self._contents = None, False
        self.feed(source)
        self.text, kind = " ".join(self.words), "application/json"
        self.figures = [json.loads(text) for tag, text in self.scripts if tag.get("type") == kind]

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self.tags.append(tag)
        urls = [str(attributes[name]) for name in ("src", "href", "data") if name in attributes]
        # A link is followed by a click only.
        (self.links if tag == "a" else self.loads).extend(urls)
        if attributes.get("http-equiv") == "Content-Security-Policy":
            self.csp = str(attributes["content"])
        if tag == "script":
            self.scripts.append((attributes, ""))
        if tag not in VOID:
            self._inside = tag
        self._contents |= tag == "nav"

    def handle_endtag(self, tag):
        self._inside = None
        self._contents &= tag != "nav"

    def handle_data(self, data):
        if self._inside == "script":
            attributes, text = self.scripts[-1]
            self.scripts[-1] = (attributes, text + data)
        elif self._inside != "style" and not self._contents:
            self.words.append(data)

    @property
    def titles(self) -> list[str]:
        return [figure["layout"]["title"]["text"] for figure in self.figures]


@pytest.fixture
def built(reported_run) -> Path:
    return reported_run / "report.html"


@pytest.fixture(scope="module")
def page(reported_run) -> Page:
    return Page((reported_run / "report.html").read_text(encoding="utf-8"))


def test_every_placement_is_in_tables_maps_and_clouds(page):
    layouts = [figure["layout"] for figure in page.figures]
    axes = [layout.get("yaxis", {}).get("ticktext", []) for layout in layouts]
    menus = [menu for layout in layouts for menu in layout.get("updatemenus", [])]
    entries = [button["label"] for menu in menus for button in menu["buttons"]]
    for name in NAMES:
        assert name in page.words
        escaped = html.escape(name, quote=False)
        assert any(title.startswith(escaped) for title in page.titles)
        assert any(escaped in rows for rows in axes)
        assert escaped in entries


def test_it_is_one_file_that_loads_nothing(built, page):
    assert page.loads == []
    assert page.csp.startswith("default-src 'none'")
    assert not {"link", "img", "iframe", "base"} & {*page.tags}
    style = re.search(r"<style>(.*?)</style>", built.read_text(), re.S)[1]
    assert not re.search(r"@import|url\(", style)
    assert sum("Plotly.newPlot" in text and len(text) < 6000 for _, text in page.scripts) == 1
    assert built.stat().st_size < 15e6
    assert [path.name for path in built.parent.iterdir() if "part" in path.name] == []


def test_the_sections_are_in_order(page):
    titles = ["Highest mean for Car", "Which placement is best?"]
    titles += ["Surrogates: error against run time", "Placements"]
    titles += ["Which placement is best for each class and setting?", "Can a surrogate be trusted?"]
    titles += ["Does the placement matter?", "Rigs and traffic", "Coverage and residual entropy"]
    titles += ["One frame, as each placement sees it", "Objects: boxes and individuals"]
    titles += [
        "Objects by their distance",
        "Surrogates: sampling error of the POG",
        "Where the time went",
    ]
    titles += ["Configuration and command"]
    assert [word for word in page.words if word in titles] == titles
    assert not {"Promotion", "Do the surrogates agree?"} & {*page.words}
    assert "lidarplace run examples/grid.yaml" in page.words


def test_the_surrogate_that_a_finding_names_is_in_its_figures(built):
    run = RunFolder.read(built.parent)
    part = run.results.query("`class` == 'Car' and metric == 'AP_R40_3D' and iou == 0.7")
    means = part.groupby("placement", as_index=False)["value"].mean()
    perfect = means.assign(**{"class": "Car", "surrogate": "log_points"})
    others = run.surrogates.query("surrogate == 's_mig'")
    others = others.assign(value=np.random.default_rng(0).permutation(others["value"]))
    part = replace(run, surrogates=pd.concat([others, perfect]))
    analysis, name = Analysis(part), surrogate_name("log_points")
    first, section = coefficient_map_section(analysis), predictors_section(analysis)
    assert f"The strongest is {name}" in section.notes[0]
    assert section.notes[0] == first.notes[0]
    assert name in first.figures[1].to_json()
    assert (section.tables[0].rows[0][0], section.tables[0].rows[0][3]) == ("Car", name)


def test_it_names_the_best_placement_and_the_weaknesses(built, page):
    results = pd.read_parquet(built.parent / "results.parquet")
    own = results.query("`class` == 'Car' and metric == 'AP_R40_3D' and iou == 0.7")
    means = own.groupby("placement")["value"].mean()
    headline = page.words[page.words.index("Highest mean for Car") :]
    assert next(word for word in headline if word in NAMES) == means.idxmax()
    sd = own.groupby("placement")["value"].std()[means.idxmax()]
    assert f"{means.max():.1f} ± {sd:.1f}" in page.text
    assert "Only 5 placements: no two-sided p-value can be below 0.017" in page.text
    assert "Two seeds" in page.text
    assert "Cyclist: no ground truth" in page.text


def test_a_name_cannot_become_a_tag(tmp_path):
    evil = "</script><script>alert(1)</script>"
    folder = write_run(tmp_path / "evil", names=["line", evil, "<img src=http://x/>"])
    (folder / "config.yaml").write_text(f"name: '{evil}'\n")
    page = Page(build_report(folder).read_text(encoding="utf-8"))
    assert page.loads == []
    assert evil in page.words
    assert not any(text.strip() == "alert(1)" for _, text in page.scripts)
    texts = json.dumps(page.figures)
    assert "&lt;img" in texts
    assert "<img" not in texts


def test_axes_and_detectors_get_their_own_figures(tmp_path):
    detectors, densities = ("tiny", "second"), (40, 120)
    folder = write_run(tmp_path / "axes", NAMES[:2], (1,), detectors, densities)
    page = Page(report_of(folder, "best", "by_class").read_text(encoding="utf-8"))
    for group in ("tiny, density = 40", "tiny, density = 120", "second, density = 120"):
        assert any(title.startswith(f"Car · {group}") for title in page.titles)
        assert f"Highest mean for Car · {group}" in page.words
    assert "One seed" in page.text


def test_what_the_sweep_did_not_make_is_said(made_up_run, tmp_path):
    folder = shutil.copytree(made_up_run, tmp_path / "bare")
    names = ("individuals", "accuracy", "sampling_error", "pog_resamples", "tasks", "points")
    optional = ("maps.npz", "frame.npz", *(f"{name}.parquet" for name in (*names, "distance")))
    for name in optional:
        (folder / name).unlink()
    sections = ("individuals", "accuracy", "sampling_error", "where_time_went", "by_distance")
    page = Page(report_of(folder, "coverage", "clouds", *sections).read_text(encoding="utf-8"))
    for name in ("frame.npz", *(f"{name}.parquet" for name in ("individuals", "tasks", "points"))):
        assert name in page.text
    for key in ("accuracy", "sampling_error"):
        assert f"not computed; surrogate.{key} of a sweep adds them." in page.text
    assert "The run folder has no maps of residual entropy." in page.text


def test_studies_of_some_placements_say_of_which(made_up_run, built, tmp_path):
    folder = shutil.copytree(made_up_run, tmp_path / "some")
    for name in ("accuracy", "sampling_error", "pog_resamples"):
        table = pd.read_parquet(folder / f"{name}.parquet")
        table = table[table["placement"].isin(["line", "trapezoid"])]
        table.to_parquet(folder / f"{name}.parquet", index=False)
    sentence = "Computed for 2 of 5 placements: line, trapezoid."
    report_of(folder, "accuracy", "sampling_error")
    assert (folder / "report.md").read_text(encoding="utf-8").count(sentence) == 2
    assert "Computed for" not in built.with_suffix(".md").read_text(encoding="utf-8")


def test_without_times_or_cores_there_is_no_efficiency(run):
    before = replace(run, tasks=run.tasks.assign(started=np.nan, ended=np.nan))
    assert where_time_went(Analysis(before)).notes[-1] == "No task ran, so no efficiency."
    sweep = run.sweep.model_copy(update={"cores": None})
    older = where_time_went(Analysis(replace(run, sweep=sweep)))
    assert "does not say how many cores" in older.notes[-1]
    assert not older.tables


def test_the_clock_is_that_of_the_last_command(run):
    clock = "The last command took 1,234 s on the clock."
    again = " It found 1 of the 22 results in place, so this is not the time of the whole sweep."
    assert where_time_went(Analysis(run)).notes[0] == clock + again
    fresh = replace(run, tasks=run.tasks.assign(cached=False))
    assert where_time_went(Analysis(fresh)).notes[0] == clock


@pytest.fixture
def tasks():
    """Two stages that overlap by a second, and a result that was there before."""
    rows = [("pog", 1.0, 4.0, 1.5, 2e8), ("pog", 1.0, 3.0, 1.0, 3e8)]
    rows += [("train", 3.0, 11.0, 8.0, np.nan), ("train", np.nan, np.nan, 5.0, np.nan)]
    return pd.DataFrame(rows, columns=["stage", "started", "ended", "seconds", "peak_memory"])


def test_stages_have_their_own_seconds_from_first_start_to_last_end(tasks):
    table = stage_times(tasks).set_index("stage")
    assert table.loc["pog"].tolist() == [2, 2.5, 3, (1.5 + 1) / 2, 3e8]
    assert table.loc["train"].tolist()[:4] == [1, 8, 8, 0]
    assert stage_times(tasks.iloc[3:]).empty


def test_idle_time_counts_for_the_efficiency_of_the_whole(run, tasks):
    uncached = tasks.assign(cached=tasks["started"].isna(), node="")
    work = "3 tasks did 10 s of work on 2 cores in 11 s"
    note = where_time_went(Analysis(replace(run, tasks=uncached))).notes[1]
    assert note.startswith(f"{work}: parallel efficiency {10.5 / 22:.2f}, ")


def test_a_sweep_of_surrogates_alone_ranks_placements_on_a_small_page(tmp_path):
    names = [f"p{i:03d}" for i in range(500)]
    folder = write_run(tmp_path / "alone", names=names, detectors=())
    built = build_report(folder)
    page = Page(built.read_text(encoding="utf-8"))
    assert built.stat().st_size < 15e6
    assert sum(len(json.dumps(figure)) for figure in page.figures) < 3e6
    assert page.tags.count("tr") < 1000
    surrogates = pd.read_parquet(folder / "surrogates.parquet")
    gain = surrogates.query("surrogate == 'expected_recall'")
    of_car = gain[gain["class"] == "Car"].set_index("placement")["value"]
    verdict = page.words[page.words.index("Highest expected recall for Car") :]
    assert next(word for word in verdict if word in names) == of_car.idxmax()
    assert "the sweep has no detector" in page.text
    caption = next(word for word in page.words if word.startswith("Car · H_POG"))
    assert caption.endswith("the first 50 of 500 rows, the CSV file has all")
    table = page.words[page.words.index(caption) :]
    total = gain.groupby("placement")["value"].sum().sort_values(ascending=False)
    assert [word for word in table if word in names][:50] == total.index[:50].tolist()
    ig = surrogates.query("surrogate == 'expected_ig' and `class` == 'Car'")
    of_car, first = ig.set_index("placement")["value"], total.index[0]
    assert f"{of_car[first]:,.1f} ({of_car.rank(ascending=False)[first]:.0f})" in table
    assert "Do the surrogates agree?" in page.words
    assert sum(title.endswith(" · covered") for title in page.titles) == 12
    assert "12 of 500 placements are drawn." in page.text


def test_a_sweep_with_one_placement_has_a_report(tmp_path):
    folder = write_run(tmp_path / "one", names=["line"])
    page = Page(build_report(folder).read_text(encoding="utf-8"))
    assert "line" in page.words[page.words.index("Highest mean for Car") :]
    assert "One placement" in page.text


@pytest.mark.parametrize("has_columns", [True, False])
def test_a_sweep_whose_trials_all_failed_has_a_report(made_up_run, tmp_path, has_columns):
    folder = shutil.copytree(made_up_run, tmp_path / "failed")
    names = ("results", "surrogates", "curves", "accuracy", "sampling_error")
    for name in names:
        table = pd.read_parquet(folder / f"{name}.parquet").iloc[:0]
        (table if has_columns else pd.DataFrame()).to_parquet(folder / f"{name}.parquet")
    trials, tasks = (pd.read_parquet(folder / f"{name}.parquet") for name in ("trials", "tasks"))
    trials = trials.assign(status="failed", error="Traceback\nValueError: no points")
    trials.to_parquet(folder / "trials.parquet")
    reduced = (tasks["stage"] == "train") & (tasks["label"] == "center")
    tasks.assign(batch_size_reduced=reduced).to_parquet(folder / "tasks.parquet")
    page = Page(build_report(folder).read_text(encoding="utf-8"))
    assert "10 of 10 trials did not finish. The first error: ValueError: no points" in page.text
    assert "no detector was evaluated" in page.text
    assert "line · covered" in page.titles
    assert "1 training ran with a smaller batch than configured" in page.text
    assert "for lack of memory: center." in page.text


def test_the_command_rebuilds_it_or_says_what_is_wrong(tmp_path):
    built = write_run(tmp_path / "run", names=["line"], detectors=()) / "report.html"

    def report(folder):
        result = CliRunner().invoke(app, [str(folder)], catch_exceptions=False)
        return result.exit_code, result.stdout.strip(), result.stderr

    assert report(built.parent) == (0, str(built), "")
    page = Page(built.read_text(encoding="utf-8"))
    assert "line" in page.words[page.words.index("Highest expected recall for Car") :]
    assert "Fewer than 3 placements: no rank agreement" in page.text
    built.unlink()
    built.mkdir()
    assert report(built.parent) == (2, "", f"{built}: Is a directory\n")


def test_the_fastest_that_ranks_alike_is_named_with_its_error(built):
    section = accuracy_section(Analysis(RunFolder.read(built.parent)))
    table = pd.read_parquet(built.parent / "accuracy.parquet").query("`class` == 'Car'")
    summary = summarise(relative_errors(table)).query("surrogate == 's_mig'")
    reference = summary[summary["reference"]].iloc[0]
    alike = summary[(summary["kendall"] == 1) & (summary["seconds"] < reference["seconds"])]
    sentence = section.notes[0]
    assert sentence.startswith("Car: ")
    assert f"{reference['resolution']:g} m ({reference['seconds']:.2g} s)." in sentence
    if alike.empty:
        assert "no faster S-MIG ranks" in sentence
    else:
        assert f"{alike['seconds'].min():.2g} s a placement" in sentence
