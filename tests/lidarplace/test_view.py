"""The page of a frame: what is drawn, where, and what a mistake is answered."""

import itertools
import json
import re

import numpy as np
import pandas as pd
import pytest

from lidarplace import PAPER_PLACEMENTS
from lidarplace.clouds.profiles import PROFILES
from lidarplace.commands.view import app
from lidarplace.configuration.placement import read_placement
from lidarplace.logs.box_log import BoxLog, write_box_log
from lidarplace.logs.boxes import BOX_COLUMNS, BUILDING_COLUMNS, corners
from lidarplace.viewing.frame import busiest_frame, read_frame
from lidarplace.viewing.scene import draw_frame
from lidarplace.viewing.solids import edges, headings, triangles
from tests.sweeps.toy import call

CROP = (0.0, -20.0, 0.0, 40.0, 20.0, 4.0)
NASTY = "</script><b>&$x"
LOG = BoxLog(
    pd.DataFrame(
        [
            ("town", 3, 0.0, "1", "Car", 10.0, 1.0, 0.8, 4.5, 1.8, 1.6, np.pi / 2),
            ("town", 5, 0.1, "1", "Car", 11.0, 1.0, 0.8, 4.5, 1.8, 1.6, 0.1),
            ("town", 5, 0.1, NASTY, "Pedestrian", 15.0, 5.0, 0.9, 0.5, 0.5, 1.8, 0.1),
            ("town", 3, 0.0, "2", "Car", -30.0, 1.0, 0.8, 4.5, 1.8, 1.6, 0.1),
            ("town", 3, 0.0, "3", "Car", -20.0, 1.0, 0.8, 4.5, 1.8, 1.6, 0.1),
        ],
        columns=list(BOX_COLUMNS),
    ),
    pd.DataFrame({"scene": "town", "frame": [3, 4, 5]}).assign(
        timestamp_s=0.0, route=0, split="train", ego_x=100.0, ego_y=50.0, ego_yaw=np.pi / 2
    ),
    # Seen from (100, 50) by one who looks along y: 20 m ahead, 10 m to the left.
    pd.DataFrame(
        [("town", 90.0, 70.0, 4.0, 6.0, 8.0, 8.0, np.pi / 2)], columns=list(BUILDING_COLUMNS)
    ),
)
TURNED = np.array([[10.0, 2.0, 1.0, 4.0, 2.0, 1.5, np.pi / 2], [0, 0, 0, 1, 2, 3, 0.3]])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("log")
    write_box_log(path, LOG)
    return path


def run(*arguments, code=0):
    return call(app, *arguments, code=code)


def marks(figure, size):
    return [t for t in figure.data if t.type == "scatter3d" and t.marker.size == size]


def test_corners_and_headings_of_a_turned_box():
    assert corners(TURNED)[0, 0] == pytest.approx([11, 0, 0.25])  # rear, right, bottom
    assert corners(TURNED)[0, 7] == pytest.approx([9, 4, 1.75])  # front, left, top
    middle, front, gap = headings(TURNED)[0]
    assert middle == pytest.approx([10, 2, 1.75])
    assert front == pytest.approx([10, 4, 1.75])
    assert np.isnan(gap).all()


def test_the_line_runs_along_each_of_the_twelve_edges_of_each_box():
    for box in TURNED:
        steps = itertools.pairwise(edges(box[None]).round(4).tolist())
        pairs = {tuple(sorted(map(tuple, ends))) for ends in steps if np.isfinite(ends).all()}
        lengths = sorted(np.linalg.norm(np.subtract(*pair)) for pair in pairs)
        assert lengths == pytest.approx(sorted([*box[3:6]] * 4), abs=1e-3)
    both = edges(TURNED)
    assert np.array_equal(both, np.concatenate([edges(TURNED[:1]), edges(TURNED[1:])]), True)


def test_triangles_cover_the_faces():
    vertices, faces = triangles(TURNED)
    a, b, c = vertices[faces].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).reshape(2, 12).sum(axis=1) / 2
    length, width, height = TURNED[:, 3:6].T
    surface = 2 * (length * width + length * height + width * height)
    assert area == pytest.approx(surface, rel=1e-5)


def test_the_busiest_frame_counts_objects_in_the_roi_only():
    assert busiest_frame(LOG, CROP) == 5  # frame 3 has more boxes
    assert busiest_frame(LOG, (-40.0, -20.0, 0.0, 0.0, 20.0, 4.0)) == 3
    assert busiest_frame(LOG, (50.0, -20.0, 0.0, 90.0, 20.0, 4.0)) == 3  # the first of equals
    with pytest.raises(ValueError, match="no frame"):
        busiest_frame(BoxLog(LOG.boxes[:0], LOG.frames[:0]), CROP)


def test_a_frame_holds_what_may_reach_into_the_roi():
    frame = read_frame(LOG, 3, CROP)
    assert frame.objects["object_id"].tolist() == ["1"]
    assert frame.inside.tolist() == [True]
    assert frame.buildings == pytest.approx(np.array([[20.0, 10, 4, 6, 8, 8, 0]]))
    edge = read_frame(LOG, 3, (11.0, -20.0, 0.0, 40.0, 20.0, 4.0))
    assert (edge.objects["object_id"].tolist(), edge.inside.tolist()) == (["1"], [False])


def test_a_scene_shows_clouds_by_lidar_boxes_by_class_and_what_stands_around():
    profile = PROFILES["released-code"]
    placement = profile.placement(PAPER_PLACEMENTS["pyramid"].with_lidar(profile.lidar))
    figure = draw_frame(LOG, 5, placement, CROP, misaligned_heights=True)
    clouds, mounts = marks(figure, 1.2), marks(figure, 4)
    assert [trace.name for trace in clouds] == [f"LiDAR {i + 1}" for i in range(4)]
    assert len({trace.marker.color for trace in clouds}) == 4
    points = np.concatenate([np.stack([t.x, t.y, t.z], axis=1) for t in clouds])
    assert points.dtype == np.float32
    # The ground of the second LiDAR, 0.2 m higher than the first, sinks and is still shown.
    assert min(clouds[1].z) == pytest.approx(-0.2, abs=0.001)
    low = np.array(CROP[:3]) - [0, 0, 0.9]
    assert ((points >= low - 1e-3) & (points <= np.array(CROP[3:]) + 1e-3)).all()
    at = np.array([[t.x[0], t.y[0], t.z[0]] for t in mounts])
    assert at == pytest.approx(np.array([mount.position for mount in placement.mounts]))
    names = {trace.name for trace in figure.data}
    assert {"Car", "Pedestrian", "ROI", "vehicle", "buildings"} < names
    assert "Cyclist" not in names

    # As many points as the title says, and on objects as counted here.
    objects = 0
    for box in LOG.boxes[LOG.boxes["frame"] == 5].itertuples():
        offset = points - [box.x, box.y, box.z]
        c, s = np.cos(box.yaw), np.sin(box.yaw)
        local = np.abs(np.stack([offset @ [c, s, 0], offset @ [-s, c, 0], offset[:, 2]], axis=1))
        grown = np.array([box.length, box.width, box.height]) / 2 + 0.05
        objects += (local <= grown).all(axis=1).sum()
    assert objects > 0
    assert figure.layout.title.subtitle.text == f"{len(points):,} points, {objects} on objects"


def test_large_clouds_are_thinned_at_random_and_the_title_says_so():
    placement = PAPER_PLACEMENTS["line"]
    figure = draw_frame(LOG, 4, placement, CROP, points=500)
    drawn = marks(figure, 1.2)
    assert sum(len(trace.x) for trace in drawn) == 500
    assert all(len(trace.x) > 60 for trace in drawn)  # all LiDARs have their share
    summary = r"[\d,]{6,} points, 500 drawn, 0 on objects"
    assert re.fullmatch(summary, figure.layout.title.subtitle.text)


def test_the_page_shows_placements_side_by_side_whatever_names_say(folder, tmp_path):
    own = tmp_path / "mine.yaml"
    own.write_text("mounts:\n- {x: 0.5, z: 2.0, roll: 0.1}\n- {z: 1.9, yaw: 3.14}\n")
    out = tmp_path / "new" / "page.html"
    options = ("--placement", "center", "--placement", own, "--profile", "released-code")
    result = run(folder, *options, "--out", out)
    assert (result.exit_code, result.stderr) == (0, "")
    assert "frame 5, 2 objects" in result.stdout
    page = out.read_text(encoding="utf-8")
    figures = re.findall(r'<script type="application/json">(.*?)</script>', page, re.DOTALL)
    titles = [json.loads(figure)["layout"]["title"]["text"] for figure in figures]
    assert titles == ["center", "mine"]
    hover = [text for t in json.loads(figures[0])["data"] for text in t.get("hovertext", [])]
    assert any(text.startswith("&lt;/script&gt;&lt;b&gt;&amp;$x") for text in hover)
    assert "default-src 'none'" in page  # nothing is loaded from anywhere
    assert page.count("</script>") == len(figures) + 2
    assert [path.name for path in out.parent.iterdir()] == ["page.html"]


def test_an_empty_frame_makes_a_page(folder, tmp_path):
    out = tmp_path / "page.html"
    options = ("--frame", 4, "--placement", "line", "--profile", "released-code")
    nowhere = ("--roi", 0, 0.1, 0, 0.1, 50, 51)
    run(folder, *options, *nowhere, "--out", out)
    assert "0 points" in out.read_text(encoding="utf-8")


def test_mounts_of_a_file_may_have_their_own_lidar_and_be_in_degrees(tmp_path):
    path = tmp_path / "rig.yaml"
    own = "lidar: {beams: 4, azimuth_steps: 90}, roll_deg: 10, yaw: 0.5, yaw_deg: null"
    path.write_text(f"mounts: [{{z: 2}}, {{z: 1, {own}}}]")
    rig = read_placement(path, PROFILES["paper"].lidar)
    assert [lidar.rays for lidar in rig.lidars] == [90_000, 360]
    mount = rig.mounts[1]
    assert (mount.roll, mount.pitch, mount.yaw) == (pytest.approx(np.radians(10)), 0.0, 0.5)
