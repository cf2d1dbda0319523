"""Figures of a sweep as files: which there are, what they show, and that they do not change."""

import json
import re
from collections.abc import Iterator
from functools import partial

import matplotlib
import pytest
from matplotlib.container import ErrorbarContainer
from matplotlib.figure import Figure
from typer.testing import CliRunner

from tests.tracking.made_up_run import NAMES, write_run
from tracking.kitti_iou import at_headline_iou
from tracking.report import paper_figures as paper
from tracking.report.analysis import Analysis
from tracking.report.figures_command import app
from tracking.run_folders.sweep import RunFolder


def made(analysis: Analysis) -> dict[str, Figure]:
    """Every figure that has data, by its title."""
    makers = paper._makers(analysis, paper._surrogates(analysis)[:1])
    with matplotlib.rc_context(paper._STYLE):
        figures = {title: make() for _, title, make in makers}
    return {title: figure for title, figure in figures.items() if figure is not None}


def legend(figure: Figure) -> list[str]:
    """Names in the legend of a figure."""
    return [text.get_text() for text in figure.legends[0].get_texts()]


STARTS = {"pdf": b"%PDF", "svg": b"<?xml", "png": b"\x89PNG"}


@pytest.fixture(scope="module")
def analysis(run) -> Iterator[Analysis]:
    return Analysis(run)


@pytest.mark.parametrize("kind", paper.FORMATS)
def test_each_kind_of_file_is_written_and_the_same_again(analysis, tmp_path, kind, monkeypatch):
    monkeypatch.setattr(paper, "_surrogates", lambda analysis: ["s_mig"])
    first, again = (
        {path.name: path.read_bytes() for path in paper.write_figures(analysis, folder, kind)}
        for folder in (tmp_path / "a", tmp_path / "b")
    )
    assert {f"s-mig-against-metrics.{kind}", f"clouds.{kind}"} <= set(first)
    assert f"error-against-run-time.{kind}" in first
    assert all(content.startswith(STARTS[kind]) for content in first.values())
    assert first == again
    width = made(analysis)["error against run time"].get_figwidth()
    assert width == paper.COLUMN_INCHES


def test_points_are_means_over_seeds_with_their_names(analysis):
    figures = made(analysis)
    axis = figures["s_mig against metrics"].axes[0]
    bars = [c for c in axis.containers if isinstance(c, ErrorbarContainer)]
    means = at_headline_iou(analysis.means, analysis.run.results, "Car").set_index("placement")
    heights = {bar.get_label(): bar.lines[0].get_ydata()[0] for bar in bars}
    assert heights == means["mean"].to_dict()
    assert legend(figures["s_mig against metrics"]) == list(NAMES)
    assert [axis.get_title() for axis in figures["clouds"].axes] == analysis.order


def test_density_has_the_first_detector_with_names_that_matplotlib_would_hide(tmp_path):
    names = ("_line", "center", "high")
    folder = write_run(tmp_path / "a", names, densities=(20, 40), detectors=("second", "other"))
    dense = Analysis(RunFolder.read(folder))
    figure = paper._density(dense)
    assert legend(figure) == ["_line", "center", "high"]
    means = at_headline_iou(dense.means, dense.run.results, "Car")
    first = means[(means["detector"] == "second") & (means["placement"] == "_line")]
    (line,) = (one for one in figure.axes[0].lines if one.get_label() == "_line")
    assert list(line.get_xdata()) == [20, 40]
    assert list(line.get_ydata()) == first.sort_values("scene.density")["mean"].tolist()


def test_tilts_have_the_pairs_of_the_first_detector_once(tmp_path):
    folder = write_run(tmp_path / "a", NAMES[:2], detectors=("second", "other"))
    about = json.loads((folder / "sweep.json").read_text())
    level, _ = about["placements"].values()
    about["placements"]["center"] = [[*mount[:3], 0.2, *mount[4:]] for mount in level]
    (folder / "sweep.json").write_text(json.dumps(about))
    (axis,) = paper._tilts(Analysis(RunFolder.read(folder))).axes
    assert [label.get_text() for label in axis.get_yticklabels()] == ["line → center, roll"]


def test_numbers_of_logarithmic_axes_are_plain(analysis):
    figure = made(analysis)["error against run time"]
    figure.canvas.draw()
    (axis,) = figure.axes
    words = [label.get_text() for label in (*axis.get_xticklabels(), *axis.get_yticklabels())]
    assert any(words)
    assert all(re.fullmatch(r"[0-9.e-]*", word) for word in words)


def test_names_of_files_are_safe_and_distinct(analysis, tmp_path):
    again = ["generalist's 3D AP", "generalist's 3D-AP", "generalist's_3D_AP"]
    make = partial(paper._placements, analysis)
    written = paper._write([("best", name, make) for name in again], tmp_path, "png", 50)
    stem = "generalist-s-3d-ap"
    assert [path.name for _, path in written] == [f"{stem}{end}.png" for end in ("", "-2", "-3")]


def test_surrogates_alone_have_few_figures_and_a_search_none(tmp_path):
    alone = Analysis(RunFolder.read(write_run(tmp_path / "alone", detectors=())))
    assert set(made(alone)) == {"error against run time"}
    (tmp_path / "search.json").write_text("{}")
    result = CliRunner().invoke(app, [str(tmp_path)])
    assert result.exit_code == 2
    assert result.stderr == f"{tmp_path}: the folder of a search; expected that of a sweep\n"
