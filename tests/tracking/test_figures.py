"""Numbers that the figures plot."""

from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np
import pandas as pd
import pytest

from lidarplace.base.roi import Roi
from tracking.figures.kit.named_points import add_placements, label_places
from tracking.figures.kit.style import (
    COLOURS,
    SYMBOLS,
    colour,
    figure,
    legend_below,
    lidar_colour,
    symbol,
    theme,
)
from tracking.figures.kit.vehicle_lines import pog_from_above
from tracking.findings.surrogate_accuracy import relative_errors, summarise
from tracking.pages.section import figure_title
from tracking.report.sections.accuracy import accuracy_figure
from tracking.report.sections.clouds import POINTS, point_clouds
from tracking.run_folders.arrays import Frame

ROI = Roi(x=(0, 50), y=(-10, 10), z=(0, 4), resolution=0.1)


def test_maps_keep_their_mean_and_their_place():
    entropy = np.random.default_rng(0).random((500, 200)).astype(np.float32)
    heat = pog_from_above(entropy, ROI, "POG").data[0]
    cells = np.asarray(heat.z).T
    assert max(cells.shape) <= 200
    assert (heat.x[0], heat.x[-1]) == pytest.approx((0, 50))
    assert (heat.y[0], heat.y[-1]) == pytest.approx((-10, 10))
    area = np.diff(heat.x)[:, None] * np.diff(heat.y)[None, :]
    assert (cells * area).sum() == pytest.approx(entropy.mean(dtype=float) * 50 * 20, rel=1e-5)
    # Cell (i, j) is the mean of its own block, x first.
    assert cells[1, 2] == pytest.approx(entropy[3:6, 6:9].mean(), rel=1e-5)


def test_clouds_are_thinned_inside_the_roi_and_seeded(run):
    points = np.random.default_rng(0).uniform(-60, 60, (200_000, 4)).astype(np.float32)
    lidar = {"line": np.repeat([0, 2], 100_000).astype(np.uint8), "center": np.zeros(10, np.uint8)}
    boxes, labels = np.array([[10.0, 2, 1, 4, 2, 1.5, np.pi / 2]]), np.array(["Car"])
    frame = Frame(boxes, labels, {"line": points, "center": points[:10]}, lidar)
    run = replace(run, roi=ROI)
    plot = point_clouds(run, frame, ["line", "center"])
    (cloud,) = (trace for trace in plot.data if trace.type == "scattergl" and trace.visible)
    assert set(cloud.marker.color) == {0, 2}
    assert len(cloud.x) == POINTS
    assert np.min(cloud.x) >= 0
    assert np.max(np.abs(cloud.y)) <= 10
    scale = cloud.marker.colorscale
    at = (2 - cloud.marker.cmin) / (cloud.marker.cmax - cloud.marker.cmin)
    ends = [shade for (low, shade), (high, _) in pairwise(scale) if low < at < high]
    assert ends == [lidar_colour(2)]
    again = point_clouds(run, frame, ["line", "center"])
    assert np.array_equal(again.data[0].x, plot.data[0].x)
    (car,) = (trace for trace in plot.data if trace.name == "Car")
    # Turned by a quarter: 4 m along y, 2 m along x.
    assert (np.nanmin(car.x), np.nanmax(car.x)) == pytest.approx((9, 11))
    assert (np.nanmin(car.y), np.nanmax(car.y)) == pytest.approx((0, 4))
    shown = [button.args[0]["visible"] for button in plot.layout.updatemenus[0].buttons]
    assert shown == [[True, False, True, True], [False, True, True, True]]


def test_zero_errors_are_hollow_and_below_and_the_menu_shows_one_surrogate(run):
    both = pd.concat([run.accuracy, run.accuracy.assign(surrogate="m_sog")])
    plot = accuracy_figure(summarise(relative_errors(both)), "Car")
    first, second = (button.args[0]["visible"] for button in plot.layout.updatemenus[0].buttons)
    assert [trace.visible for trace in plot.data] == first
    assert [not visible for visible in first] == second
    (line,) = (t for t in plot.data if t.visible and t.name == "cone, resolution")
    assert "diamond-open" in line.marker.symbol
    assert min(line.y) > 0


def test_labels_of_near_points_take_different_places():
    x, y = np.array([0.0, 0.0, 10.0]), np.array([1.0, 1.05, 5.0])
    places = label_places(x, y, ["trapezoid", "pyramid_roll", "line"])
    assert places[0] != places[1]
    assert places[2] == "middle left"  # at the right edge


def test_a_label_keeps_off_the_bar_of_its_neighbour():
    x, y = np.array([0.0, 1.0, 10.0]), np.array([1.0, 3.0, 9.0])
    assert label_places(x, y, ["one", "", ""])[0] == "middle right"
    # Its bar reaches down beside the first point.
    assert label_places(x, y, ["one", "", ""], np.array([np.nan, 3.0, 0.0]))[0] != "middle right"


@pytest.mark.parametrize(("count", "mode"), [(20, "markers+text"), (21, "markers")])
def test_points_are_labelled_while_there_are_few(count, mode):
    names, at = [f"p{i}" for i in range(count)], np.arange(float(count))
    plot = figure("Car", 400)
    add_placements(plot, at, at, at, names, names)
    assert plot.data[0].mode == mode
    assert plot.data[0].text == tuple(names), "a pointer shows it"


def test_series_differ_by_their_markers_too():
    count = len(COLOURS) * len(SYMBOLS)
    assert len({(colour(i), symbol(i)) for i in range(count)}) == count
    assert len({symbol(i) for i in range(8)}) == 8


def linear_rgb(colours):
    parts = np.array([[int(c[i : i + 2], 16) for i in (1, 3, 5)] for c in colours]) / 255
    return np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)


def test_the_lidars_of_a_rig_differ_for_every_eye():
    """Least distance of the first four colours, seen without red or green cones. Machado, Oliveira
    and Fernandes 2009, severity 1; distances in CIELAB, 2.3 is just noticed."""
    deuteranopia = [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413]]
    deuteranopia += [[-0.011820, 0.042940, 0.968881]]
    protanopia = [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216]]
    protanopia += [[-0.003882, -0.048116, 1.051998]]

    def least(colours):
        linear = linear_rgb(colours)
        to_xyz = [[0.4125, 0.3576, 0.1804], [0.2127, 0.7152, 0.0722], [0.0193, 0.1192, 0.9503]]
        distances = []
        for matrix in (deuteranopia, protanopia):
            light = np.clip(linear @ np.array(matrix).T, 0, 1) @ np.array(to_xyz).T
            x, y, z = np.cbrt(light / [0.9505, 1, 1.089]).T
            lab = np.stack([116 * y, 500 * (x - y), 200 * (y - z)], axis=1)
            distances += [np.linalg.norm(a - b) for a, b in combinations(lab, 2)]
        return min(distances)

    assert least([lidar_colour(i) for i in range(4)]) > 22
    # The plain order has two greys among the first four.
    assert least([colour(i) for i in range(4)]) < 20
    assert len({lidar_colour(i) for i in range(len(COLOURS))}) == len(COLOURS)


def test_a_long_title_is_broken_and_its_figure_grows():
    name = "Car · " + "second_tiny, density = 40, " * 4
    short, long = figure("Car", 400), figure(name, 400)
    lines = long.layout.title.text.split("<br />")
    assert max(map(len, lines)) <= 50
    assert len(lines) == 3
    assert long.layout.height - short.layout.height == 2 * 18
    assert long.layout.margin.t - short.layout.margin.t == 2 * 18
    assert figure_title(long) == " ".join(lines)
    assert "<br" not in short.layout.title.text


@pytest.mark.parametrize(
    ("name", "rows"), [("line", 3), ("pyramid_pitch", 5), ("second_tiny, density = 40", 5)]
)
def test_a_legend_has_room_for_its_names(name, rows):
    plot = figure("Car", 400)
    for i in range(5):
        plot.add_scatter(x=[i], y=[i], name=name)
    plot.add_scatter(x=[0], y=[0], name="no entry", showlegend=False)
    plot.add_scatter(x=[0], y=[0], name="chosen by the menu", visible=False)
    legend_below(plot)
    assert plot.layout.height == 400 + 20 * rows
    # All of the room is below the legend's upper edge.
    assert plot.layout.legend.y * plot.layout.height >= 20 * rows


def test_a_legend_has_room_for_groups_and_for_a_title_of_two_lines():
    """Plotly gives a group a row of its own: a phone cut the last of them."""
    plot = figure("Car", 400)
    plot.update_xaxes(title="objects: ← line alone<br>center alone →")
    for i in range(3):
        plot.add_scatter(x=[i], y=[i], name="line", legendgroup="chance" if i == 1 else None)
    legend_below(plot)
    assert plot.layout.height == 400 + 20 * 3 + 18
    assert plot.layout.margin.b == 56 + 20 * 3 + 18
    assert plot.layout.legend.tracegroupgap == 0


def test_both_themes_can_be_read():
    for dark, page in ((False, "#ffffff"), (True, "#15181c")):
        ink = theme(dark)["layout"]["font"]["color"]
        low, high = np.sort(linear_rgb([ink, page]) @ [0.2126, 0.7152, 0.0722])
        assert (high + 0.05) / (low + 0.05) > 7
