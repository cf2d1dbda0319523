"""Numbers that the figures of a search plot."""

from dataclasses import replace

import numpy as np
import pandas as pd
import plotly.graph_objects as go
import pytest

from lidarplace.base.roi import Roi
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.requirements.recall_ground import RecallGround
from lidarplace.rigs.placement import Mount
from tracking.figures.kit.grounds import detected_grounds, ground_note
from tracking.figures.kit.rig_picture import PicturedRig, label_places, rig_picture
from tracking.figures.of_searches import pareto_fronts, robustness_figure, search_history, unseen
from tracking.findings.failures import Failures
from tracking.run_folders.search_json import Objective, Rig, Zone
from tracking.search_report.cautions import at_the_edge

GAIN = Objective(name="gain", by="expected_ig", unit="nats", direction="maximize")
PRICE = Objective(name="price", by="price", unit="€", direction="minimize")
ANGLES = {"roll_deg": (-20, 20), "pitch_deg": (3, 3), "yaw_deg": (-180, 180)}
NO_BODY = Vehicle("none", np.empty((0, 2, 3)))
ROOF = Zone(name="roof", polygon=((0, 0), (1, 0), (0, 1)), z=(1.5, 2.0), **ANGLES)


def rig(*mounts: tuple[float, ...], role: str = "found", **values: float) -> Rig:
    count = len(mounts)
    return Rig.model_validate(
        {"role": role, "mounts": mounts, "models": ["a"] * count, "zones": ["roof"] * count}
        | {"values": {}, "searched": values, "measures": {}, "feasible": True}
    )


def trace(plot: go.Figure, name: str):
    return next(trace for trace in plot.data if trace.name == name)


@pytest.mark.parametrize(
    ("objective", "best"), [(GAIN, [np.nan, 3, 3, 5, 5]), (PRICE, [np.nan, 3, 2, 2, 1])]
)
def test_the_best_so_far_counts_feasible_trials_alone(objective, best):
    values = [9.0, 3.0, 2.0, 5.0, 1.0] if objective is GAIN else [0.5, 3.0, 2.0, 5.0, 1.0]
    trials = pd.DataFrame({"number": [4, 5, 6, 8, 9], f"value.{objective.name}": values})
    trials["feasible"] = trials["number"] > 4
    plot = search_history(trials, objective, None, 4.0, {"line": 3.0, "center": 2.0})
    np.testing.assert_array_equal(trace(plot, "best so far").y, best)
    assert trace(plot, "trial that breaks a constraint").customdata.tolist() == [4]
    assert [*trace(plot, "greedy").y] == [4.0, 4.0]
    assert [*trace(plot, "line, best of the paper").y] == [3.0, 3.0]
    assert "upper bound" not in [t.name for t in plot.data]


def test_maps_share_a_scale_and_the_difference_is_about_zero():
    roi = Roi(x=(0, 2), y=(0, 1), z=(0, 1), resolution=0.5)
    before = np.array([[4.0, 0.0], [1.0, 1.0], [0.0, 0.0], [0.0, 0.0]], np.float32)
    after = np.array([[1.0, 2.0], [1.0, 1.0], [0.0, 0.0], [0.0, 0.0]], np.float32)
    plots = unseen(before, after, roi, NO_BODY, ("Car", "a", "b"))
    first, second, less = (plot.data[0] for plot in plots)
    assert (first.zmin, first.zmax) == (second.zmin, second.zmax) == (0, 4)
    assert (less.zmin, less.zmax) == (-3, 3)
    np.testing.assert_array_equal(less.z, (after - before).T)
    nothing = np.zeros((4, 2), np.float32)
    plots = unseen(nothing, nothing, roi, NO_BODY, ("Car", "a", "b"))
    assert [(plot.data[0].zmin, plot.data[0].zmax) for plot in plots] == [(0, 1), (0, 1), (-1, 1)]


def test_the_menu_shows_one_rig_and_its_axes_turn_with_it():
    turned = rig((1.0, 0.0, 2.0, 0.0, 0.0, np.pi / 2))
    rigs = {"a": turned, "b": rig((0, 0, 3, 0, 0, 0), (0, 1, 3, 0, 0, 0))}
    pictured = {
        name: PicturedRig.in_zones(flags.placed, flags.models, flags.zones)
        for name, flags in rigs.items()
    }
    plot = rig_picture(pictured, NO_BODY, [ROOF])
    forward = trace(plot, "sensor's x")
    ends = np.stack([forward.x, forward.y, forward.z], axis=1)
    np.testing.assert_allclose(ends[:2], [[1, 0, 2], [1, 1.5, 2]], atol=1e-6)  # as of a pole
    buttons = plot.layout.updatemenus[0].buttons
    assert [button.label for button in buttons] == ["a", "b"]
    assert list(buttons[0].args[0]["visible"]) == [t.visible for t in plot.data]
    visible = [button.args[0]["visible"] for button in buttons]
    traces = [[t for t, on in zip(plot.data, flags, strict=True) if on] for flags in visible]
    assert [
        len(next(t for t in flags if t.name and t.name.startswith("LiDAR")).x) for flags in traces
    ] == [1, 2]
    assert all(any(t.name == "zones" for t in flags) for flags in traces)
    low, high = plot.layout.scene.zaxis.range
    assert low < 1.5
    assert high > 3  # the rig that is not shown fits as well


def test_numbers_of_lidars_in_a_stack_are_apart_in_the_first_view():
    stack = np.array([[0.0, 0.0, 2.4 + 0.02 * i] for i in range(4)] + [[0.7, 0.6, 2.4]])
    places = label_places(stack, 0.4)
    eye = np.array([0.72, 0.58, 0.6])
    along = eye / np.linalg.norm(eye)
    seen = places - np.outer(places @ along, along)
    apart = np.linalg.norm(seen[:, None] - seen[None], axis=2) + 9 * np.eye(len(stack))
    assert apart.min() > 0.39
    np.testing.assert_allclose(places @ along, (stack @ along).max() + 3 * 0.4, atol=1e-9)
    above = (seen - stack + np.outer(stack @ along, along)) @ [-eye[1], eye[0], 0.0]
    assert [*np.sign(above[:4])] == [1, -1, 1, -1], "beside the stack, not on it"


def test_a_known_ground_has_an_entry_with_its_worst_lidar_dead():
    built = np.full((3, 2), 0.8)
    built[1, 0] = np.nan
    x, y = np.array([-1.0, 0.0, 1.0]), np.array([-1.0, 1.0])
    ground = RecallGround("Car", x, y, built, built - 0.3, dead=1)
    pair = PicturedRig.of([Mount(z=2.0), Mount(y=0.5, z=2.0)], ["a, 16 beams", "b, 32 beams"])
    rigs = {"best": replace(pair, ground=ground), "other": pair}
    plot = rig_picture(rigs, None)
    labels = [button.label for button in plot.layout.updatemenus[0].buttons]
    assert labels == ["best", "best, LiDAR 2 dead", "other"]
    grounds = [np.array(t.surfacecolor) for t in plot.data if t.type == "surface"]
    assert [float(cells.max()) for cells in grounds] == pytest.approx([0.8, 0.5])
    assert not np.isnan(grounds[0]).any()
    numbers = [
        list(t.text)
        for t in plot.data
        if t.type == "scatter3d" and t.mode == "text" and " m" not in t.text[0]
    ]
    assert numbers == [["1 a", "2 b"], ["1 a", "2 b dead"], ["1 a", "2 b"]]
    assert "best 80.0 % (50.0 % with LiDAR 2 dead)" in ground_note(rigs)
    assert "rate_hz" not in ground_note(rigs)
    timed = {"best": replace(rigs["best"], ground=replace(rigs["best"].ground, takes_time=True))}
    assert "They ignore rate_hz." in ground_note(timed)
    assert ground_note({"other": pair}) == ""


def test_the_ground_as_detected_has_the_share_found_in_cells_with_enough_objects():
    rng = np.random.default_rng(3)
    objects = pd.DataFrame({"x": rng.uniform(-7, 20, 400), "y": rng.uniform(0, 11, 400)})
    found = rng.random((2, 400, 3)) < 0.6
    points = np.zeros((2, 400))
    rigs = ("a", "b")
    compared = Failures(rigs, ("Car",), (0, 1, 2), rigs, objects, found, points, False)
    grounds = detected_grounds(compared)
    full = 0
    for i, x in enumerate(grounds["b"].x):
        for j, y in enumerate(grounds["b"].y):
            cell = (objects["x"] // 5 == x // 5) & (objects["y"] // 5 == y // 5)
            wanted = found[1][cell].mean() if cell.sum() >= 10 else np.nan
            np.testing.assert_allclose(grounds["b"].built[i, j], wanted)
            full += cell.sum() >= 10
    assert 0 < full < grounds["b"].built.size
    ground = RecallGround("Car", np.arange(2.0), np.arange(2.0), *2 * [np.full((2, 2), 0.5)], None)
    pictured = PicturedRig((Mount(z=2.0),), ("",), ground, grounds["a"])
    plot = rig_picture({"a": pictured}, None)
    labels = [button.label for button in plot.layout.updatemenus[0].buttons]
    assert labels == ["a", "a, as detected"]
    expected, detected = (np.array(t.z) for t in plot.data if t.type == "surface")
    assert not np.isnan(expected).any()
    assert (np.isnan(detected) == np.isnan(grounds["a"].built.T)).all()
    few = replace(compared, objects=objects[:9], found=found[:, :9], points=points[:, :9])
    assert detected_grounds(few) == {}


def test_rings_on_the_ground_are_the_scale():
    plot = rig_picture({"a": PicturedRig.of([Mount(z=2.0)])}, None)
    in_space = [trace for trace in plot.data if trace.type == "scatter3d"]
    labels = next(trace for trace in in_space if trace.mode == "text")
    of_lines = [t for t in in_space if t.mode == "lines" and len(t.z)]
    lines = next(t for t in of_lines if not np.nan_to_num(t.z).any())
    middle = (np.nanmax(lines.x) + np.nanmin(lines.x)) / 2
    radii = np.hypot(lines.x - middle, lines.y).reshape(-1, 74)[:, :73]
    wanted = [float(word.removesuffix(" m")) for word in labels.text]
    np.testing.assert_allclose(radii, np.broadcast_to(wanted, (73, len(wanted))).T, atol=1e-5)
    assert not any(plot.layout.scene[f"{axis}axis"].visible for axis in "xyz")


def test_each_pair_of_objectives_has_a_front_in_order():
    other = Objective(name="near", by="near", unit="", direction="maximize")
    rigs = {
        "dear": rig((0, 0, 2, 0, 0, 0), gain=9, price=5, near=1),
        "cheap": rig((0, 0, 2, 0, 0, 0), gain=4, price=1, near=2),
        "line": rig((0, 0, 2, 0, 0, 0), role="paper", gain=3, price=4, near=1),
    }
    trials = pd.DataFrame({"number": [0], "feasible": [True], "value.near": [1.0]})
    trials = trials.assign(**{"value.gain": 1.0, "value.price": 2.0})
    plots = pareto_fronts(trials, (GAIN, PRICE, other), rigs, ["dear", "cheap"])
    assert len(plots) == 3
    front = trace(plots[0], "Pareto front")
    assert [*front.text] == ["cheap", "dear"]
    assert ([*front.x], [*front.y]) == ([4, 9], [1, 5])
    assert [*trace(plots[0], "the paper's eight").text] == ["line"]
    rigs["line"] = rig((0, 0, 2, 0, 0, 0), role="paper", gain=3)  # without a price
    plot = pareto_fronts(trials, (GAIN, PRICE), rigs, ["dear"])[0]
    assert "the paper's eight" not in [t.name for t in plot.data]
    assert plot.layout.yaxis.title.text == "price (€), less is better"


def test_robustness_is_in_percent_of_one_value_for_all_rigs_with_the_worst():
    rows = pd.DataFrame(
        {"rig": ["a", "a", "base"], "case": ["as designed", "mounts off", "mounts off"]}
        | {"value": [240.0, 180.0, 190.0], "worst": [240.0, 150.0, 160.0]}
    )
    plot = robustness_figure(rows, GAIN, "base", 200.0)
    points = trace(plot, "a")
    np.testing.assert_allclose(points.x, [120, 90])
    np.testing.assert_allclose(points.error_x.arrayminus, [0, 15])
    np.testing.assert_allclose(trace(plot, "base").x, [np.nan, 95])
    assert plot.layout.xaxis.title.text == "percent of base as designed,<br>more is better"


@pytest.mark.parametrize("designed", [0.0, -3.0, np.nan])
def test_robustness_has_a_unit_where_there_is_no_percent(designed):
    rows = pd.DataFrame({"rig": ["a"], "case": ["mounts off"], "value": [5.0], "worst": [7.0]})
    plot = robustness_figure(rows, PRICE, "base", designed)
    assert [*trace(plot, "a").x] == [5.0]
    assert [*trace(plot, "a").error_x.array] == [2.0]
    assert plot.layout.xaxis.title.text == "price (€),<br>less is better"


def test_edges_of_zones_and_of_the_angles_that_were_allowed():
    inside = rig((0.2, 0.2, 1.7, 0.1, np.radians(3), np.pi))
    assert at_the_edge(inside, (ROOF,)) == []
    # On the slanted side of the polygon, at its top, and with the largest roll.
    out = rig((0.5, 0.499, 2.0, np.radians(20), np.radians(3), 0.0))
    assert at_the_edge(out, (ROOF,)) == ["LiDAR 1: x, y, z, roll"]
    point = Zone(name="roof", polygon=((0.2, 0.2),), z=(1.7, 1.7), **ANGLES)
    assert at_the_edge(inside, (point,)) == []
    backwards = ROOF.model_copy(update={"yaw_deg": (170, 190)})
    assert at_the_edge(inside, (backwards,)) == []
    turned = rig((0.2, 0.2, 1.7, 0, 0, np.radians(-170.0)))
    assert at_the_edge(turned, (backwards,)) == ["LiDAR 1: yaw"]


def test_a_lidar_that_was_not_searched_is_at_no_edge():
    assert at_the_edge(rig((0.5, 0.499, 2.0, 0.0, 0.0, 0.0)), ()) == []
    assert at_the_edge(rig((0.2, -0.2, 2.0, 0.0, 0.0, 0.0)), (ROOF,)) == []  # a mirror image
