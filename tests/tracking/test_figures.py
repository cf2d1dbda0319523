"""What the figures show, in numbers."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from lidarplace.placement import Mount
from lidarplace.roi import Roi
from tracking.accuracy import relative_errors, summarise
from tracking.figures.accuracy import accuracy_figure
from tracking.figures.coverage_maps import SeenFrom, coverage_maps, densest
from tracking.figures.from_above import pog_from_above
from tracking.figures.label_places import label_places
from tracking.figures.point_cloud import POINTS, point_clouds
from tracking.figures.style import theme
from tracking.figures.times import times
from tracking.run_folder import Frame, RunFolder

ROI = Roi(x=(0, 50), y=(-10, 10), z=(0, 4), resolution=0.1)


def test_maps_keep_their_mean_and_their_place():
    rng = np.random.default_rng(0)
    entropy = rng.random((500, 200)).astype(np.float32)
    heat = pog_from_above(entropy, ROI, "POG").data[0]
    cells = np.asarray(heat.z).T
    assert max(cells.shape) <= 200
    assert (heat.x[0], heat.x[-1]) == pytest.approx((0, 50))
    assert (heat.y[0], heat.y[-1]) == pytest.approx((-10, 10))
    area = np.diff(heat.x)[:, None] * np.diff(heat.y)[None, :]
    assert (cells * area).sum() == pytest.approx(entropy.mean(dtype=float) * 50 * 20, rel=1e-5)
    # Cell (i, j) is the mean of its own block, x first.
    assert cells[1, 2] == pytest.approx(entropy[3:6, 6:9].mean(), rel=1e-5)


def test_maps_of_coverage_and_residual_share_their_scales():
    roi = Roi(x=(0, 20), y=(-10, 10), z=(0, 4), resolution=0.5)
    above = SeenFrom(np.zeros((40, 40), np.float32), np.zeros((40, 40), np.float32))
    side = SeenFrom(np.zeros((40, 8), np.float32), np.zeros((40, 8), np.float32))
    above.covered[0, 3] = 0.5
    above.residual[7, 1] = 3.0
    side.residual[7, 2] = 2.0
    most = densest([above.residual, above.residual * 2], roi, roi.y)
    assert most == pytest.approx(6 / 0.25), "nats a square metre"
    plot = coverage_maps(above, side, roi, "line", [Mount(x=1, y=2, z=3)], (most, 9.0))
    heats = [trace for trace in plot.data if trace.type == "heatmap"]
    assert [heat.zmax for heat in heats] == [100, most, 100, 9]
    cells = [np.asarray(heat.z) for heat in heats]
    assert cells[0][3, 0] == 50
    assert cells[1][1, 7] == pytest.approx(12)
    assert cells[3].shape == (8, 40)
    assert cells[3][2, 7] == pytest.approx(8)
    dots = [trace for trace in plot.data if trace.type == "scatter" and trace.mode == "markers"]
    assert [(dot.x, dot.y) for dot in dots] == [((1,), (2,))] * 2 + [((1,), (3,))] * 2


def test_clouds_are_thinned_inside_the_roi_and_seeded():
    rng = np.random.default_rng(0)
    points = rng.uniform(-60, 60, (200_000, 4)).astype(np.float32)
    frame = Frame(
        points={"line": points, "center": points[:10]},
        lidar={
            "line": np.repeat([0, 2], 100_000).astype(np.uint8),
            "center": np.zeros(10, np.uint8),
        },
        boxes=np.array([[10.0, 2, 1, 4, 2, 1.5, np.pi / 2]]),
        labels=np.array(["Car"]),
    )
    plot = point_clouds(frame, ROI, ["line", "center"], "line")
    clouds = [trace for trace in plot.data if trace.type == "scattergl" and trace.visible]
    assert [trace.name for trace in clouds] == ["LiDAR 0", "LiDAR 2"]
    assert sum(len(trace.x) for trace in clouds) == POINTS
    assert all(np.min(trace.x) >= 0 and np.max(np.abs(trace.y)) <= 10 for trace in clouds)
    again = point_clouds(frame, ROI, ["line", "center"], "line")
    assert np.array_equal(again.data[0].x, plot.data[0].x)
    (car,) = (trace for trace in plot.data if trace.name == "Car")
    # Turned by a quarter: 4 m along y, 2 m along x.
    assert (np.nanmin(car.x), np.nanmax(car.x)) == pytest.approx((9, 11))
    assert (np.nanmin(car.y), np.nanmax(car.y)) == pytest.approx((0, 4))
    menu = plot.layout.updatemenus[0].buttons
    shown = [sum(button.args[0]["visible"][: len(plot.data)]) for button in menu]
    assert shown == [2 + 2, 1 + 2]


def test_zero_errors_are_hollow_and_below_and_the_menu_shows_one_surrogate(made_up_run):
    table = RunFolder.read(made_up_run).accuracy
    both = pd.concat([table, table.assign(surrogate="m_sog")])
    plot = accuracy_figure(summarise(relative_errors(both)), "Car")
    first, second = (button.args[0]["visible"] for button in plot.layout.updatemenus[0].buttons)
    assert [trace.visible for trace in plot.data] == first
    assert [not shown for shown in first] == second
    lines = [t for t in plot.data if t.visible and t.name == "cone, resolution" and t.xaxis == "x2"]
    (line,) = lines
    assert "diamond-open" in line.marker.symbol
    assert min(line.y) > 0


def test_times_are_summed_by_stage_and_by_what_was_cached():
    table = pd.DataFrame(
        {
            "stage": ["train", "train", "scene", "train"],
            "seconds": [1.0, 2.0, 4.0, 8.0],
            "cached": [False, False, True, True],
        }
    )
    spent, spared = times(table).data
    assert dict(zip(spent.y, spent.x, strict=True)) == {"train": 3.0}
    assert dict(zip(spared.y, spared.x, strict=True)) == {"train": 8.0, "scene": 4.0}


def test_labels_of_near_points_take_different_places():
    x, y = np.array([0.0, 0.0, 10.0]), np.array([1.0, 1.05, 5.0])
    places = label_places(x, y, ["trapezoid", "pyramid_roll", "line"])
    assert places[0] != places[1]
    assert places[2] == "middle left"  # at the right edge


def test_both_themes_can_be_read():
    def luminance(colour):
        parts = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
        linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
        return linear @ [0.2126, 0.7152, 0.0722]

    for dark, page in ((False, "#ffffff"), (True, "#15181c")):
        ink = theme(dark)["layout"]["font"]["color"]
        high, low = sorted((luminance(ink), luminance(page)), reverse=True)
        assert (high + 0.05) / (low + 0.05) > 7
