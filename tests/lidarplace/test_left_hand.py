"""Left-hand traffic: OpenDRIVE's rule LHT and SUMO's networks; nobody drives on the wrong side."""

import math
import subprocess
from pathlib import Path
from xml.etree.ElementTree import Element, fromstring, tostring

import numpy as np
import pytest

from lidarplace.logs.box_log import BoxLog
from lidarplace.scenes.kinds import obstacles_around, scene_parts
from lidarplace.scenes.site import Site
from lidarplace.scenes.sumo.mirror import mirror_map
from lidarplace.scenes.sumo.settings import SumoScene

pytest.importorskip("sumolib")
from lidarplace.scenes.sumo.record import record
from lidarplace.scenes.sumo.town import sumo_home

STREET = Path(__file__).parents[1] / "data/maps/street.xodr"

SHORT = {"routes": 4, "test_routes": 0, "frames_per_route": 30, "warmup_s": 20}
SMALL = SumoScene(density=16, pedestrians=4, **SHORT)


def log_of(path: Path, **changes) -> BoxLog:
    return record(SMALL.model_copy(update={"towns": (str(path),), **changes}))


@pytest.fixture(scope="module")
def street() -> BoxLog:
    return log_of(STREET)


def check_oncoming(log: BoxLog, side: int) -> None:
    """Vehicles that come straight towards the ego on its road have a y of this sign."""
    boxes = log.boxes[log.boxes["class"] != "Pedestrian"]
    facing = np.cos(boxes["yaw"]) < -0.9999
    y = boxes.loc[facing & boxes["x"].between(2, 40) & (boxes["y"].abs() < 7), "y"]
    assert len(y) > 20
    assert (side * y > 0).all()


def left_hand(path: Path, source: str) -> Path:
    path.write_text(source.replace("<road ", '<road rule="LHT" '))
    return path


def test_an_opendrive_street_is_driven_on_the_left(tmp_path, street):
    """Its right lane is made broader: sides must not be exchanged either."""
    source = STREET.read_text()
    left, right = source.split("<center>")
    source = f"{left}<center>{right.replace('3.5', '5.5', 1)}"
    log = log_of(left_hand(tmp_path / "street.xodr", source))
    check_oncoming(log, -1)
    check_oncoming(street, 1)
    # The reference line is y = 5 up to x = 0, and bends to the left behind that.
    frames = log.frames[log.frames["ego_x"] < -10]
    along = np.cos(frames["ego_yaw"]) > 0
    assert 10 < along.sum() < len(frames) - 10
    assert frames.loc[along, "ego_y"].between(5.5, 5 + 3.5 - 0.5).all()
    assert frames.loc[~along, "ego_y"].between(5 - 5.5 + 0.5, 4.5).all()
    assert frames.loc[~along, "ego_y"].min() < 5 - 3.5, "the lane is 5.5 m broad"
    assert log.frames["ego_y"].max() > 30
    assert log.buildings["y"].max() > 30


@pytest.fixture(scope="module")
def grid(tmp_path_factory) -> tuple[Path, Path]:
    """A town with left-hand traffic, by SUMO: its network, and as OpenDRIVE with junctions."""
    folder = tmp_path_factory.mktemp("grid")
    network, plain = folder / "grid.net.xml", folder / "plain.xodr"
    programs = sumo_home() / "bin"
    made = [
        *("--grid", "--grid.x-number", "3", "--grid.y-number", "2", "--grid.length", "90"),
        *("--lefthand", "--no-turnarounds", "--sidewalks.guess", "--crossings.guess"),
    ]
    written = ["--opendrive-output", str(plain), "--opendrive-output.lefthand-left"]
    generate = [programs / "netgenerate", *made, "--output-file", str(network)]
    convert = [programs / "netconvert", "--sumo-net-file", str(network), *written]
    for command in (generate, convert):
        quiet = ["--no-warnings", "--xml-validation", "never"]
        subprocess.run([*command, *quiet], check=True, capture_output=True)
    return network, left_hand(folder / "grid.xodr", plain.read_text())


@pytest.mark.parametrize("kind", [0, 1])
def test_a_town_is_driven_on_the_left(grid, kind):
    log = log_of(grid[kind], density=24, pedestrians=0, routes=6)
    check_oncoming(log, -1)
    assert len(log.buildings) > 20
    # Lanes are 3.2 m wide, and the streets are the lines x = 0, 90, 180 and y = 0, 90.
    frames = log.frames
    east = frames[(np.cos(frames["ego_yaw"]) > 0.999) & (frames["ego_x"] % 90).between(15, 75)]
    assert len(east) > 10
    assert (east["ego_y"] % 90).between(0.5, 2.7).all()


@pytest.fixture(scope="module")
def mirrored(tmp_path_factory) -> Path:
    """The mirror image of `STREET`, where vehicles keep left."""
    root = fromstring(STREET.read_text())
    mirror_map(root)
    path = tmp_path_factory.mktemp("mirrored") / "street.xodr"
    return left_hand(path, tostring(root, "unicode"))


def check_mirror_image(log: BoxLog, other: BoxLog) -> None:
    assert len(log.boxes) > 100
    for table, ego in (("boxes", ""), ("frames", "ego_"), ("buildings", "")):
        a, b, y, yaw = getattr(log, table), getattr(other, table), f"{ego}y", f"{ego}yaw"
        np.testing.assert_allclose(b[y], -a[y], atol=1e-9)
        np.testing.assert_allclose(np.exp(1j * b[yaw]), np.exp(-1j * a[yaw]), atol=1e-9)
        kept = [name for name in a.columns if name not in (y, yaw)]
        assert a[kept].equals(b[kept])
        assert b[yaw].between(-math.pi, math.pi, inclusive="right").all()


def test_the_mirror_image_of_a_map_has_the_mirror_image_of_its_traffic(mirrored, street):
    check_mirror_image(street, log_of(mirrored))


def test_a_site_of_the_mirror_image_is_the_mirror_image_of_a_site(mirrored):
    logs, walls, lanes = [], [], []
    for path, side in ((STREET, 1), (mirrored, -1)):
        scene = SMALL.model_copy(update={"towns": (str(path),), "routes": 1})
        site = Site(x=-30.0, y=side * 4.0, yaw_deg=side * 35.0)
        logs.append(scene_parts(scene, site)[0].recording.record())
        around = obstacles_around(scene, site)
        walls.append(around.buildings)
        lanes.append(around.lanes)
    check_mirror_image(*logs)
    assert logs[0].frames["ego_yaw"].iloc[0] == pytest.approx(math.radians(35))
    for (one, other), yaw in ((walls, 6), (lanes, 2)):
        sides = np.ones(one.shape[1])
        sides[[1, yaw]] = -1
        assert len(one) > 3
        np.testing.assert_allclose(other, one * sides, atol=1e-9)


GEOMETRIES = """<OpenDRIVE><road>
  <geometry x="3" y="-2.5" hdg="0.3" length="20"><line/></geometry>
  <geometry x="-3" y="+2.5e1" hdg="-0.7" length="20"><arc curvature="-0.02"/></geometry>
  <geometry x="0" y="0" hdg="2" length="20"><spiral curvStart="0.01" curvEnd="-0.05"/></geometry>
  <geometry x="1" y="1" hdg="1" length="20"><poly3 a="0" b="0.1" c="-0.02" d="0.001"/></geometry>
  <geometry x="1" y="7" hdg="1" length="20"><paramPoly3 pRange="arcLength"
    aU="0" bU="1" cU="-0.001" dU="0" aV="0.5" bV="0" cV="-0.02" dV="1e-3"/></geometry>
</road></OpenDRIVE>"""


def line_of(geometry: Element) -> np.ndarray:
    """Points of a reference line by OpenDRIVE's definitions; headings are integrated."""

    def number(element: Element, name: str) -> float:
        return float(element.get(name, "nan"))

    (shape,) = geometry
    s = np.linspace(0, number(geometry, "length"), 2001)
    if shape.tag in ("line", "arc", "spiral"):
        names = {"line": (), "arc": ("curvature",) * 2, "spiral": ("curvStart", "curvEnd")}
        ends = [number(shape, name) for name in names[shape.tag]] or [0.0, 0.0]
        curvature = ends[0] + (ends[1] - ends[0]) * s / s[-1]
        heading = np.concatenate([[0], np.cumsum((curvature[1:] + curvature[:-1]) / 2 * s[1])])
        steps = (turn(heading)[:-1] * s[1] for turn in (np.cos, np.sin))
        u, v = (np.concatenate([[0], np.cumsum(step)]) for step in steps)
    elif shape.tag == "poly3":
        u, v = s, np.polyval([number(shape, name) for name in "dcba"], s)
    else:
        u, v = (np.polyval([number(shape, f"{k}{axis}") for k in "dcba"], s) for axis in "UV")
    x, y, turned = (number(geometry, name) for name in ("x", "y", "hdg"))
    cos, sin = math.cos(turned), math.sin(turned)
    return np.stack([x + cos * u - sin * v, y + sin * u + cos * v])


def test_every_kind_of_line_is_mirrored():
    root = fromstring(GEOMETRIES)
    before = [line_of(geometry) for geometry in root.iter("geometry")]
    mirror_map(root)
    for (x, y), geometry in zip(before, root.iter("geometry"), strict=True):
        assert np.ptp(y) > 1
        np.testing.assert_allclose(line_of(geometry), [x, -y], atol=1e-9)


LANES = """<OpenDRIVE><road><lanes><laneOffset a="1" b="-2" c="0.5" d="0"/><laneSection>
  <left><lane id="2" type="a"/><lane id="1" type="b"><link><successor id="-1"/></link></lane></left>
  <center><lane id="0" type="none"/></center>
  <right><lane id="-1" type="c"><link><predecessor id="-2"/></link></lane></right>
</laneSection></lanes></road><junction><connection><laneLink from="1" to="-1"/></connection>
</junction></OpenDRIVE>"""


def test_lanes_change_sides():
    root = fromstring(LANES)
    mirror_map(root)
    sides = {
        side.tag: [(int(lane.attrib["id"]), lane.get("type")) for lane in side]
        for side in root.find(".//laneSection")
    }
    assert sides == {"left": [(1, "c")], "center": [(0, "none")], "right": [(-1, "b"), (-2, "a")]}
    assert list(sides) == ["left", "center", "right"]
    assert [link.get("id") for link in root.iterfind(".//lane/link/*")] == ["2", "1"]
    assert root.find(".//laneLink").attrib == {"from": "-1", "to": "1"}
    offset = {name: float(value) for name, value in root.find(".//laneOffset").attrib.items()}
    assert offset == {"a": -1, "b": 2, "c": -0.5, "d": 0}
