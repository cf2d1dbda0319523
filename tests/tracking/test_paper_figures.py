"""Figures of a sweep as files: which there are, what they show, and that they do not change."""

from collections.abc import Iterator

import numpy as np
import pytest
from matplotlib.container import ErrorbarContainer

from tests.tracking.made_up_run import NAMES, write_run
from tracking.kitti_iou import at_headline_iou
from tracking.paper import figures as paper
from tracking.report.analysis import Analysis
from tracking.run_folders.sweep import RunFolder

STARTS = {"pdf": b"%PDF", "svg": b"<?xml", "png": b"\x89PNG"}


@pytest.fixture(scope="module")
def analysis(run) -> Iterator[Analysis]:
    return Analysis(run)


@pytest.mark.parametrize("kind", paper.FORMATS)
def test_each_kind_of_file_is_written_and_the_same_again(analysis, tmp_path, kind):
    first, again = (
        {path.name: path.read_bytes() for path in paper.write_figures(analysis, folder, kind)}
        for folder in (tmp_path / "a", tmp_path / "b")
    )
    assert {f"s_mig-against-metrics.{kind}", f"clouds.{kind}"} <= set(first)
    assert f"error-against-run-time.{kind}" in first
    assert all(content.startswith(STARTS[kind]) for content in first.values())
    assert first == again
    width = dict(paper._figures(analysis))["error-against-run-time"].get_figwidth()
    assert width == paper.COLUMN_INCHES


def test_points_are_means_over_seeds_with_their_names(analysis):
    figures = dict(paper._figures(analysis))
    axis = figures["s_mig-against-metrics"].axes[0]
    (bars,) = (c for c in axis.containers if isinstance(c, ErrorbarContainer))
    means = at_headline_iou(analysis.means, analysis.run.results, "Car").set_index("placement")
    drawn = dict(zip(means.index, np.asarray(bars.lines[0].get_ydata()), strict=True))
    assert drawn == means["mean"].to_dict()
    assert {text.get_text() for text in axis.texts} == set(NAMES)
    assert [axis.get_title() for axis in figures["clouds"].axes] == analysis.order


def test_density_has_a_line_for_each_placement_and_surrogates_alone_few_figures(tmp_path):
    dense = Analysis(RunFolder.read(write_run(tmp_path / "dense", densities=(20, 40))))
    axis = dict(paper._figures(dense))["density"].axes[0]
    assert [line.get_label() for line in axis.lines] == sorted(NAMES, key=list(NAMES).index)
    assert all(list(line.get_xdata()) == [20, 40] for line in axis.lines)
    alone = Analysis(RunFolder.read(write_run(tmp_path / "alone", detectors=())))
    assert "s_mig-against-metrics" not in dict(paper._figures(alone))
