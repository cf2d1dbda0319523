"""Maps of towns: generated, a file, or CARLA's by name."""

import contextlib
import gzip
import os
import subprocess
import zlib
from importlib.util import find_spec
from pathlib import Path
from xml.etree.ElementTree import Element, ElementTree, ParseError, fromstring, iterparse

from lidarplace.base.errors import InputError
from lidarplace.files.atomic import reading
from lidarplace.files.regular import regular
from lidarplace.scenes.sumo.mirror import mirror_map
from lidarplace.scenes.sumo.settings import GENERATED, MAP_SUFFIXES
from lidarplace.scenes.sumo.town import TownMap, build_town, sumo_home

PACKAGE = "py123d"  # a package on PyPI that carries CARLA's maps (CC-BY 4.0)
IN_PACKAGE, IN_CARLA = "parser/opendrive/carla_maps", "CarlaUE4/Content/Carla/Maps/OpenDrive"


def build_network(town: str, seed: int, folder: Path) -> TownMap:
    """Make the SUMO network of `town`, a name as in `SumoScene.towns`, in `folder` if need be.

    Raises ImportError without SUMO, ValueError if the map is missing or SUMO cannot read it."""
    if town == GENERATED:
        return TownMap(build_town(seed, folder))
    path = find_map(town)
    if path.name.endswith(".net.xml"):
        return TownMap(path, lefthand=_keeps_left(path))
    return convert_opendrive(path, folder)


def _keeps_left(network: Path) -> bool:
    """Return whether a SUMO network has left-hand traffic; readers report invalid files."""
    with contextlib.suppress(ParseError):
        for _, root in iterparse(network, events=("start",)):
            return bool(root.get("lefthand") == "true")
    return False


def find_map(town: str) -> Path:
    """Return the file of a town: its path, or that of the CARLA map of this name.

    Raises ValueError if there is none."""
    path = Path(town) if town.endswith(MAP_SUFFIXES) else find_carla_map(town)
    if not path.is_file():
        raise InputError("no such map file", place=path)
    return path


def find_carla_map(name: str) -> Path:
    """Return openDRIVE file of the CARLA map `name`, such as Town03.

    Looks in the package `py123d`, without importing it, and then in the installation of CARLA that
    the environment variable `CARLA_ROOT` names. Raises ValueError if neither has it."""
    spec, root = find_spec(PACKAGE), os.environ.get("CARLA_ROOT")
    package = spec.submodule_search_locations if spec else None
    looked = []
    for place, inside, suffix, missing in (
        (package and package[0], IN_PACKAGE, "xodr.gz", f"the package {PACKAGE} (not installed)"),
        (root, IN_CARLA, "xodr", "CARLA_ROOT (not set)"),
    ):
        if place and (path := Path(place) / inside / f"{name}.{suffix}").is_file():
            return path
        looked.append(str(Path(place) / inside) if place else missing)
    fix = f"CARLA's maps (CC-BY 4.0) come with `pip install --no-deps {PACKAGE}`, or with a CARLA "
    fix += "whose folder CARLA_ROOT names"
    raise InputError(f"no map {name!r} in {' and '.join(looked)}", fix=fix)


SPEED_M_S = 13.89
"""Speed limit of every lane, 50 km/h: netconvert does not read the limits of roads, and CARLA's
traffic stays far below those of its maps."""
_RAIL_AND_OTHERS = (
    "pedestrian rail rail_urban rail_electric rail_fast tram drone aircraft scooter container "
    "wheelchair subway cable_car ship"
)
SIDEWALKS = ("sidewalk", "walking")
"""Types of lanes for pedestrians; the second is OpenDRIVE's since version 1.8."""

_ROADS = (
    *("driving", "entry", "exit", "onRamp", "offRamp", "mwyEntry", "mwyExit", "stop"),
    *("connectingRamp", "slipLane"),
)
"""Types of lanes for all road traffic: those of SUMO's own table, and OpenDRIVE's newer ones."""
_CLOSED = {"shoulder": 1.0, "border": 0.1, "median": 0.1, "curb": 0.1, "parking": 2.5}
_CLOSED |= {"bidirectional": 3.5, "restricted": 3.5}
"""Width of lanes for nobody, metres, by their type. They keep the others in their place."""
_LANE = '<type id="{}" priority="{}" speed="{}" width="{}" {}/>'
LANE_TYPES = "\n".join(
    [
        "<types>",
        *(
            _LANE.format(name, 1, SPEED_M_S, 3.5, f'disallow="{_RAIL_AND_OTHERS}"')
            for name in _ROADS
        ),
        _LANE.format("biking", 0, SPEED_M_S, 1.5, 'allow="bicycle"'),
        *(_LANE.format(name, 0, 2.78, 2, 'allow="pedestrian"') for name in SIDEWALKS),
        *(_LANE.format(name, 0, 1.39, width, 'disallow="all"') for name, width in _CLOSED.items()),
        _LANE.format("none", 0, 1.39, 1, 'disallow="all" discard="true"'),
        "</types>",
        "",
    ]
)
"""Users of a lane, by its type in OpenDRIVE. By netconvert's own table sidewalks are left out, or
open to cars."""


def convert_opendrive(path: Path, folder: Path) -> TownMap:
    """Convert `path` (`.xodr` or `.xodr.gz`) to a SUMO network in `folder`.

    x and y stay those of OpenDRIVE, but for a map with left-hand traffic, of which the network is
    the mirror image. Cars may turn round at dead ends only; lights adapt to traffic; crossings are
    guessed, and so are sidewalks if the map has none at all. Raises ValueError for what is not
    OpenDRIVE, or has something that netconvert cannot read."""
    root = read_opendrive(path)
    lefthand = drives_left(root, path)
    if lefthand:
        mirror_map(root)
    plain, types, network = (folder / f"town.{end}" for end in ("xodr", "typ.xml", "net.xml"))
    try:
        ElementTree(root).write(plain, encoding="utf-8", xml_declaration=True)
    except RecursionError:
        raise InputError("not an OpenDRIVE map: nested too deeply", place=path) from None
    types.write_text(LANE_TYPES)
    command = [
        *(str(sumo_home() / "bin" / "netconvert"), "--opendrive-files", str(plain)),
        *("--type-files", str(types), "--output-file", str(network)),
        *("--offset.disable-normalization", "--no-turnarounds.except-deadend"),
        *("--crossings.guess", "--tls.default-type", "actuated"),
        *("--geometry.remove", "--junctions.join"),  # many edges are shorter than a car
        *("--xml-validation", "never", "--no-warnings"),
    ]
    if not any(lane.get("type") in SIDEWALKS for lane in root.iter("lane")):
        command += ["--sidewalks.guess", "--sidewalks.guess.max-speed", str(SPEED_M_S)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    if result.returncode != 0 or not network.is_file():
        errors = [line for line in result.stderr.splitlines() if line.startswith("Error")]
        message = " ".join((errors or ["Error: no network came out"])[0].split())
        raise InputError(f"not an OpenDRIVE map: netconvert: {message}", place=path)
    return TownMap(network, mirrored=lefthand)


RULES = ("RHT", "LHT")
"""Right-hand and left-hand traffic; the first is meant where a road has no rule."""


def read_opendrive(path: Path) -> Element:
    """Read the tree of `path` (`.xodr` or `.xodr.gz`), without namespaces.

    Mended is what netconvert would stop at, or drop: centre lanes without a type get "none", as
    they have no width and OpenDRIVE 1.8 has them so; lanes of types that are none of `LANE_TYPES`
    are closed; arcs of curvature 0 are lines; signals without a type are left out. Raises
    ValueError for no OpenDRIVE, a lane without id or type, or a direct junction."""
    with reading(path, "a gzip file", gzip.BadGzipFile, EOFError, zlib.error):
        data = regular(path).read_bytes()
        data = gzip.decompress(data) if path.suffix == ".gz" else data
    with reading(path, "an OpenDRIVE map", ParseError, LookupError, ValueError):
        root = fromstring(data)
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    if root.tag != "OpenDRIVE":
        raise InputError(place=path, expected="an OpenDRIVE map", found=f"root {root.tag}")
    for junction in root.iter("junction"):
        if junction.get("type") == "direct":
            place, problem = f"{path}: junction {junction.get('id')}", "netconvert cannot read it"
            expected = "connecting roads, or links from road to road"
            raise InputError(problem, place=place, expected=expected, found="type direct")
    for lane in root.iterfind(".//center/lane"):
        lane.set("type", lane.get("type", "none"))
    for road in root.iter("road"):
        for lane in road.iter("lane"):
            for name in ("id", "type"):
                if name not in lane.attrib:
                    label = f"lane {lane.get('id')}" if name == "type" else "a lane"
                    place = f"{path}: road {road.get('id')}"
                    raise InputError(f"{label} has no {name}", place=place)
            if f'"{lane.get("type")}"' not in LANE_TYPES:
                lane.set("type", "restricted")
    for geometry in root.iter("geometry"):
        for arc in geometry.findall("arc"):
            with contextlib.suppress(ValueError):
                if float(arc.get("curvature", "nan")) == 0:
                    arc.tag, arc.attrib = "line", {}
    for signals in root.iter("signals"):
        for signal in [each for each in signals.findall("signal") if not each.get("type")]:
            signals.remove(signal)
    return root


def drives_left(root: Element, path: Path) -> bool:
    """Return whether a map has left-hand traffic.

    Raises ValueError for unknown or different rules."""
    first: dict[str, str | None] = {}
    for road in root.iter("road"):
        rule = road.get("rule", RULES[0])
        if rule not in RULES:
            place, expected = f"{path}: road {road.get('id')}", " or ".join(RULES)
            raise InputError(place=place, key="rule", expected=expected, found=repr(rule))
        first.setdefault(rule, road.get("id"))
    if len(first) > 1:
        roads = f"road {first['LHT']} with rule LHT, road {first['RHT']} with RHT or none"
        expected = "either left-hand or right-hand traffic"
        raise InputError(place=path, expected=expected, found=roads)
    return "LHT" in first
