"""The decision page of made-up runs."""

import html
import json
from base64 import b64decode
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from lidarplace.rigs.placement import Mount
from tests.tracking.made_up_run import report_of, write_run
from tests.tracking.test_report import Page
from tracking.figures.kit.rig_picture import PicturedRig
from tracking.figures.kit.side_by_side import side_by_side
from tracking.findings.best_placement import BestPlacement, best_placement
from tracking.labels import percent
from tracking.report.analysis import Analysis
from tracking.report.decision.rigs import rig_views
from tracking.report.decision.where_blind import _Binned, _limits, bin_table
from tracking.report.sections.objects import Bins
from tracking.run_folders.sweep import RunFolder


def read(folder: Path) -> Page:
    return Page((folder / "decision.html").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = write_run(tmp_path_factory.mktemp("decision") / "grid", seeds=(1, 2, 3), enough=True)
    (folder / "rigs.yaml").write_text("placements: {a: {mounts: [{z: 2}]}}")
    report_of(folder, "best", "failures")
    return folder


@pytest.fixture(scope="module")
def page(folder) -> Page:
    return read(folder)


@pytest.fixture(scope="module")
def one_class(tmp_path_factory) -> Page:
    """One class and one seed, with LiDAR models."""
    folder = write_run(tmp_path_factory.mktemp("one") / "car", names=["a", "b"], seeds=(1,))
    for name in ("results", "left_out", "distance", "sector", "points", "individuals"):
        table = pd.read_parquet(folder / f"{name}.parquet")
        table[table["class"].isin(["Car", "all"])].to_parquet(folder / f"{name}.parquet")
    objects, hits = (pd.read_parquet(folder / f"{name}.parquet") for name in ("objects", "found"))
    cars = objects[objects["class"] == "Car"]
    cars.to_parquet(folder / "objects.parquet")
    hits[hits["object"].isin(cars["object"])].to_parquet(folder / "found.parquet")
    sweep = json.loads((folder / "sweep.json").read_text())
    sweep["classes"] = ["Car"]
    wide = {"beams": 32, "elevation_deg": [-25.0, 15.0], "azimuth_steps": 1800}
    wide["price_usd"] = 4000.0
    near = {"name": "near<1>", "beams": 16, "elevation_deg": [-60.0, 0.0], "azimuth_steps": 900}
    sweep["lidars"] = {"a": [wide] * 4, "b": [wide, wide, near, near]}
    (folder / "sweep.json").write_text(json.dumps(sweep))
    report_of(folder, "failures")
    return read(folder)


def test_it_recommends_what_best_placement_says_with_interval_and_odds(folder, page):
    tables = {n: pd.read_parquet(folder / f"{n}.parquet") for n in ("results", "left_out")}
    of_all = {n: t.query("`class` == 'all' and metric == 'recall'") for n, t in tables.items()}
    best = best_placement(of_all["results"], left_out=of_all["left_out"])
    assert page.words[page.words.index("Recommended") + 2] == best.best
    second = best.others.iloc[0]
    low, high = (f"{value:.1f}".replace("-", "−") for value in second[["low", "high"]])
    assert (
        f"Recall @ 0.5 of all objects: {best.mean:.1f} %, {second['lead']:.1f} points ahead of "
        f"{best.others.index[0]} (95 % CI {low} to {high})"
        f"{', not significant' if second['low'] <= 0 <= second['high'] else ''}."
    ) in page.text
    assert f"{percent(best.sure.iloc[0])} likely to be the best of 5" in page.text
    assert "over seeds and over test objects, which all rigs share." in page.text
    doubt = "Other towns, other traffic or a longer training may rank the rigs otherwise"
    assert doubt in page.text


def test_it_is_one_file_whose_links_lead_to_files(folder, page):
    assert page.loads == []
    assert page.csp.startswith("default-src 'none'")
    assert "tables/best-recall-0.5-all-objects.csv" in page.links
    assert all((folder / link).is_file() for link in page.links)


def test_it_names_the_command_that_opens_its_rigs_in_the_studio(folder, page, one_class):
    assert f"lidarplace studio {folder / 'rigs.yaml'}" in page.text
    assert "lidarplace studio" not in one_class.text  # a run folder of before there were rigs.yaml


def test_it_says_where_the_recommended_rig_is_furthest_behind(folder, page):
    best = page.words[page.words.index("Recommended") + 2]
    table = pd.read_parquet(folder / "sector.parquet").query("`class` == 'Car' and iou == 0.7")
    sectors = table.groupby(["sector", "placement"])["value"].mean().unstack()
    rings = pd.read_parquet(folder / "distance.parquet")
    rings = rings.query("`class` == 'Car' and iou == 0.7 and metric == 'AP_R40_3D'")
    rings = rings.assign(ring=rings["from_m"].map({0.0: "0–10 m", 10.0: "10–20 m"}))
    both = pd.concat([sectors, rings.groupby(["ring", "placement"])["value"].mean().unstack()])
    behind = both.max(axis=1) - both[best]
    where = behind.idxmax()
    end = "is not behind any of these rigs."
    if behind[where] > 0:
        other = both.loc[where].idxmax()
        end = f"is furthest behind at {where}: {behind[where]:.1f} points below {other}."
    assert f"Car: where there are 100 objects or more, {best} {end}" in page.text


def test_colours_cover_all_cells_and_cells_of_few_objects_are_pale():
    """46 and 0 % of few objects were one colour where those of many were 60 % and more."""
    bins = Bins("direction", ("left", "front", "right"))
    values = pd.DataFrame({"left": [46.0, 0.0], "front": [60.0, 80.0]}, index=["a", "b"])
    objects = pd.Series({"left": 12, "front": 400, "right": 0})
    binned = _Binned("Car", "recall", bins, values, objects)
    limits = _limits([binned])
    assert limits == (0.0, 80.0)
    judged, few = bin_table(binned, limits).data
    assert {(t.zmin, t.zmax) for t in (judged, few)} == {limits}
    for trace, column, texts in ((judged, 1, ["60", "80"]), (few, 0, ["(46)", "(0)"])):
        assert [row[column] for row in trace.text] == texts
        assert trace.z[:, column].tolist() == values.iloc[:, column].tolist()
    assert np.isnan(judged.z[:, 0]).all()
    assert np.isnan(few.z[:, 1]).all()
    assert judged.colorscale != few.colorscale


def test_bars_of_the_chart_are_those_of_the_report(folder, page):
    chart = next(f for f in page.figures if f["layout"]["title"]["text"] == "Recall and AP")
    recall = next(t for t in chart["data"] if t["name"] == "recall @ 0.5, all objects")
    table = pd.read_csv(folder / "tables" / "best-recall-0.5-all-objects.csv")
    assert list(map(html.unescape, recall["customdata"])) == table["placement"].tolist()
    half = np.frombuffer(b64decode(recall["error_x"]["array"]["bdata"]))
    assert half == pytest.approx(table["half_interval_compared"].to_numpy())


def test_a_sweep_without_detectors_has_none_and_the_report_says_so(tmp_path):
    folder = write_run(tmp_path / "alone", names=["a", "b"], detectors=())
    (folder / "decision.html").write_text("of an earlier sweep")
    report = Page(report_of(folder, "failures").read_text(encoding="utf-8"))
    assert not (folder / "decision.html").exists()
    assert "There is no decision page" in report.text
    assert "decision.html" not in report.links


def test_one_class_is_shown_once(one_class):
    titles = [title.partition("<br>")[0] for title in one_class.titles]
    tables = [title for title in titles if " by " in title]
    assert tables == ["Car by direction", "Car by distance (m)"]
    chart = one_class.figures[titles.index("Recall and AP")]
    assert [trace["name"] for trace in chart["data"]] == ["3D AP @ 0.7", "recall @ 0.5"]
    assert one_class.text.count("Highest mean for") == 1


def test_a_legend_beside_odds_has_a_row_for_each_name():
    means = pd.DataFrame({"mean": [1.0], "low": [0.5], "high": [1.5]}, index=["a"])
    columns = {"AP": means, "recall": means}
    plain, with_odds = (side_by_side(columns, ["a"], "t", "%", odds) for odds in ((), ["60 %"]))
    assert with_odds.layout.height - plain.layout.height == 20
    assert "60 %" in [note.text for note in with_odds.layout.annotations]


def test_rigs_are_drawn_with_their_models(one_class):
    a, b = (f for f in one_class.figures if "<b>" in f["layout"]["title"]["text"])
    title = {f["layout"]["title"]["text"].partition("</b>")[0]: f for f in (a, b)}
    title_text = title["<b>a"]["layout"]["title"]["text"]
    assert "4 LiDARs · 32 beams, −25° to 15° · 16,000 US$" in title_text
    # The price of two of the others is not known.
    assert "US$" not in title["<b>b"]["layout"]["title"]["text"]
    lines = [line.rpartition(" · ")[2] for line in title["<b>b"]["data"][-1]["text"]]
    assert lines == 2 * ["32 beams, −25° to 15°"] + 2 * ["near&lt;1&gt;, 16 beams, −60° to 0°"]


def test_views_have_mounts_where_they_are_and_lines_where_they_lean_and_look():
    mount = Mount.degrees(x=0.5, y=-0.4, z=2.1, roll=30, pitch=10)
    (plot,) = rig_views([("rig", PicturedRig.of([mount]))], None)
    top, side = (trace for trace in plot.data if trace.mode == "lines+markers")
    assert (top.x[0], top.y[0]) == (0.5, -0.4)
    assert (side.x[0], side.y[0]) == (0.5, 2.1)
    # A lifted left side leans the top to the right; a nose down points below the horizon.
    assert top.y[1] - top.y[0] == pytest.approx(-0.7 * np.sin(np.radians(30)))
    assert side.y[1] - side.y[0] == pytest.approx(-0.7 * np.sin(np.radians(10)))
    assert "x 0.50, y −0.40, z 2.10 m · roll 30°, pitch 10°" in plot.data[-1].text[0]


def test_the_first_screen_has_the_rigs_on_the_vehicle_with_posts_and_what_to_do(folder, page):
    assert page.figures[0]["layout"]["title"]["text"] == "LiDARs on the vehicle"
    names = [button["label"] for button in page.figures[0]["layout"]["updatemenus"][0]["buttons"]]
    assert names[0] == page.words[page.words.index("Recommended") + 2]
    assert page.words.index("What to do next") < page.words.index("What they find")
    drawn = next(t for t in page.figures[0]["data"] if t.get("name") == "posts")
    heights = np.frombuffer(b64decode(drawn["z"]["bdata"]), np.float32).reshape(-1, 3)
    run = RunFolder.read(folder)
    assert heights[:, 0] == pytest.approx([1.5] * 4)  # the roof of the sedan
    assert heights[:, 1] == pytest.approx([mount.z for mount in run.placements[names[0]]])


def test_a_rig_beyond_the_car_is_in_view():
    (plot,) = rig_views([("truck", PicturedRig.of([Mount(x=-7.5, y=1.3, z=3.4)]))], None)
    for axis, value in (("xaxis", -7.5), ("yaxis", 1.3), ("yaxis2", 3.4)):
        low, high = plot.layout[axis].range
        assert low < value < high


@pytest.fixture
def two_densities(tmp_path) -> Path:
    folder = tmp_path / "axes"
    return write_run(folder, names=["a", "b"], densities=(40, 120), seeds=(1, 2, 3), enough=True)


def test_settings_are_answered_together(two_densities):
    report_of(two_densities, "failures")
    page = read(two_densities)
    (best,) = {answer.best for answer in answers(two_densities)}
    assert page.words[page.words.index("Recommended") + 2] == best
    assert f"{best}: the highest mean in all 2 settings." in page.text
    for density in (40, 120):
        assert f"pointpillars_tiny, density = {density}: {best}. Recall @ 0.5" in page.text
    assert "the highest mean in all 2 settings" in (two_densities / "report.md").read_text()


def test_settings_that_disagree_are_the_headline(two_densities):
    file = two_densities / "results.parquet"
    table = pd.read_parquet(file)
    is_dense = (table["class"] == "all") & (table["scene.density"] == 120)
    other = {"a": "b", "b": "a"}
    first = {answer.best for answer in answers(two_densities)}.pop()
    table.loc[is_dense, "placement"] = table.loc[is_dense, "placement"].map(other)
    table.to_parquet(file)
    report_of(two_densities, "failures")
    page = read(two_densities)
    at = page.words.index("The settings disagree")
    title = "pointpillars_tiny, density = {}"
    both = f"{first} ({title.format(40)}), {other[first]} ({title.format(120)})"
    assert page.words[at + 2] == both
    assert "Recommended" not in page.text
    assert "The settings disagree on the best placement" in page.text


def answers(folder: Path) -> list[BestPlacement]:
    return [recommendation.best for recommendation in Analysis(RunFolder.read(folder)).recommended]
