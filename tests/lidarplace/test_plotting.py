"""How the things of the library show themselves, and what is refused before it is computed."""

import math
import warnings

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

import lidarplace
from lidarplace import PAPER_PLACEMENTS, Mount, OccupancyGrid, Placement, Roi, compare, evaluate
from lidarplace.base.number_text import point
from lidarplace.clouds.collect import collect, crop_for
from lidarplace.logs.box_log import BoxLog, write_box_log
from lidarplace.scenes.sanity_checks.boxes import implausible_surroundings, implausible_units
from lidarplace.viewing.figures import figure

ROI = Roi((0, 8), (-4, 4), (0, 2), 0.5)
LINE = PAPER_PLACEMENTS["line"]
SOME = {"class": "Car", "x": 4.0, "y": 1.0, "z": 0.8, "length": 4.0, "width": 1.8, "height": 1.6}
ANGLES = st.floats(-360, 360)


def boxes(**changes):
    own = SOME | {"scene": "s", "timestamp_s": 0.0, "object_id": "a", "yaw": 0.0} | changes
    return pd.DataFrame({"frame": [0, 1, 2, 3], **own})


FRAMES = pd.DataFrame({"scene": "s", "frame": range(4), "timestamp_s": 0.0, "route": 0})
FRAMES["split"] = ["train", "train", "train", "test"]


@pytest.fixture(scope="module")
def grid():
    return OccupancyGrid.from_boxes(boxes(), ROI, "Car", frames=8)


@given(st.tuples(*[st.floats(-10, 10)] * 3), st.tuples(ANGLES, ANGLES, ANGLES))
def test_a_mount_in_degrees(position, angles):
    mount = Mount.degrees(*position, *angles)
    assert mount == Mount(*position, *np.radians(angles))
    Mount(yaw=2 * math.pi)
    again = eval(repr(mount), {"Mount": Mount})
    np.testing.assert_allclose(again.position, mount.position, rtol=1e-5, atol=1e-300)
    np.testing.assert_allclose(again.rotation, mount.rotation, atol=1e-4)


def test_each_is_a_short_line(grid):
    log = BoxLog(boxes(), FRAMES)
    clouds = collect(log, [0], LINE, crop_for((0, 8), (-4, 4), (0, 2), LINE))
    assert repr(log) == "BoxLog(4 frames (3 train, 1 test), 4 boxes (Car 4))"
    assert repr(BoxLog(log.boxes[:0], log.frames[:0])) == "BoxLog(0 frames, 0 boxes)"
    assert repr(LINE) == "Placement('line': 4 LiDARs of 16 beams; x 0, y -0.6 to 0.6, z 2.2 m)"
    occupied = f"{np.count_nonzero(grid.counts)} of them occupied in some of 8 frames"
    assert repr(grid) == f"OccupancyGrid('Car': 16 × 16 × 4 voxels of 0.5 m, {occupied})"
    assert repr(clouds).startswith("PointClouds(1 frames, 4 LiDARs, ")
    result = evaluate(grid, LINE)
    assert repr(result).startswith(f"Surrogates('line' by cone: s_mig={result.s_mig:.6g}, ")
    for thing in (log, LINE, grid, clouds, result):
        assert len(repr(thing)) < 200


def test_a_notebook_shows_tables_in_degrees_and_nothing_of_a_name_is_obeyed(grid):
    rig = Placement("<b>", [Mount.degrees(z=2, roll=-16)], lidar=LINE.lidar)
    shown = rig._repr_html_()
    assert "<td>-16</td>" in shown
    assert "<b>" not in shown
    result = evaluate(grid, rig)
    assert f"{result.covered_entropy:,.6g}" in result._repr_html_()
    assert "<b>" not in result._repr_html_()
    assert f"{grid.h_pog:,.6g}" in grid._repr_html_()


def test_the_grid_from_above(grid):
    (drawn,) = grid.plot().data
    assert drawn.type == "heatmap"
    np.testing.assert_array_equal(drawn.z, grid.probability.max(axis=2))
    front, left = np.unravel_index(np.argmax(drawn.z), drawn.z.shape)
    assert abs(drawn.y[front] - SOME["x"]) < SOME["length"] / 2
    assert abs(drawn.x[left] - SOME["y"]) < SOME["width"] / 2


def test_the_rig_and_its_entropy(grid):
    plot = PAPER_PLACEMENTS["pyramid_pitch"].plot()
    marks = [trace for trace in plot.data if (trace.name or "").startswith("LiDAR")]
    for trace, mount in zip(marks, PAPER_PLACEMENTS["pyramid_pitch"].mounts, strict=True):
        ends = np.stack([trace.x, trace.y, trace.z], axis=1)
        np.testing.assert_allclose(ends[0], mount.position)
        np.testing.assert_allclose(ends[1] - ends[0], 0.5 * mount.rotation @ [1, 0, 0])
    assert "pitch 5.2°" in marks[1].hovertext
    bars = evaluate(grid, LINE).plot().data
    assert sum(bar.x[0] for bar in bars) == pytest.approx(grid.h_pog)
    with pytest.raises(TypeError, match="no figure of a int"):
        figure(3)


def test_placements_side_by_side(grid):
    rigs = [LINE, PAPER_PLACEMENTS["center"]]
    table = compare(rigs, grid, surrogates=["expected_ig"])
    assert list(table.index) == ["line", "center"]
    for rig in rigs:
        own = evaluate(grid, rig, surrogates=["expected_ig"])
        for name in table.columns:
            assert table.loc[rig.name, name] == getattr(own, name)
    assert {"s_mig", "covered_entropy", "expected_ig"} <= set(table.columns)
    assert "expected_points" not in table  # nobody asked for it


def test_the_public_names_and_a_mistyped_placement():
    assert set(dir(lidarplace)) == set(lidarplace.__all__)
    assert all(hasattr(lidarplace, name) for name in dir(lidarplace))
    told = r"no placement 'lien' \(did you mean line\?\); there are line"
    with pytest.raises(KeyError, match=told):
        PAPER_PLACEMENTS["lien"]
    assert "lien" not in PAPER_PLACEMENTS


def test_a_class_that_the_log_alone_knows_and_one_that_never_occurs():
    trucks = OccupancyGrid.from_boxes(boxes(**{"class": "Truck"}), ROI, "Truck", 8)
    assert trucks.counts.any()
    assert not OccupancyGrid.from_boxes(boxes(), ROI, "Pedestrian", 8).counts.any()


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"yaw": [90.0, 0.0, 180.0, 0.1]}, r"2 of 4 boxes \(50 %\) are turned .* row 0: .*degrees"),
        ({"length": [4.0, 4500.0, 4.0, 4.0]}, r"1 of 4 boxes \(25 %\) are larger .* millimetres"),
        ({"length": [450.0, 400.0, 180.0, 420.0]}, r"4 of 4 boxes .* are larger .* centimetres"),
    ],
)
def test_other_units_are_told_with_their_share(changes, told):
    with pytest.warns(UserWarning, match=told):
        OccupancyGrid.from_boxes(boxes(**changes), ROI, "Car", 8)


def test_what_rounding_leaves_of_0_is_0():
    log = boxes(x=[2000.0, 0.1, 0.1, 0.1], y=[-6.8e-14, 0.0, 0.0, 0.0])
    value = next(iter(implausible_surroundings(BoxLog(log, pd.DataFrame({"frame": [0]})))))
    assert value.where(log).endswith("the first in frame 0 with x 2000, y 0")
    assert point(1e-16, -0.0, 2.25) == "(0, 0, 2.25)"


@pytest.mark.parametrize("column", ["yaw", "length"])
@pytest.mark.parametrize("value", [2 * math.pi, 7.0, 12.5, 12.6, 49.9, 50.1, 99.0, 101.0])
def test_a_conversion_rejects_what_a_grid_warns_of(column, value):
    log = boxes(**{column: [value, 0.1, 0.1, 0.2]})
    with warnings.catch_warnings(record=True) as told:
        OccupancyGrid.from_boxes(log, ROI, "Car", 8)
    values = [*implausible_units(BoxLog(log, pd.DataFrame()))]
    assert len(told) == len(values) == (value > (4 * math.pi if column == "yaw" else 50))


def test_another_log_in_the_same_folder_is_another_scene(tmp_path):
    """What is computed from a log is known by its content, and a log that changes is refused."""
    from lidarplace.scenes.recorded import LogScene, log_parts

    write_box_log(tmp_path, BoxLog(boxes(), FRAMES))
    scene = LogScene(source="log", folder=tmp_path)
    (before,) = log_parts(scene)
    assert len(before.recording.record().boxes) == 4
    write_box_log(tmp_path, BoxLog(boxes(x=5.0), FRAMES))
    (after,) = log_parts(scene)
    assert after.recording != before.recording
    assert (after.recording.record().boxes["x"] == 5.0).all()
    with pytest.raises(ValueError, match="has changed since"):
        before.recording.record()
