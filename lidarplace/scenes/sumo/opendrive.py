"""SUMO networks from OpenDRIVE."""

import subprocess
from pathlib import Path
from xml.etree.ElementTree import ElementTree

from lidarplace.scenes.sumo.mirror import mirror_map
from lidarplace.scenes.sumo.opendrive_file import drives_left, read_opendrive
from lidarplace.scenes.sumo.town import TownMap, sumo_home

SPEED_M_S = 13.89
"""Speed limit of every lane, 50 km/h: netconvert does not read the limits of roads, and CARLA's
traffic stays far below those of its maps."""

_RAIL_AND_OTHERS = (
    "pedestrian rail rail_urban rail_electric rail_fast tram drone aircraft scooter container "
    "wheelchair subway cable_car ship"
)

SIDEWALKS = ("sidewalk", "walking")
"""Types of lanes for pedestrians; the second is OpenDRIVE's since version 1.8."""

LANE_TYPES = f"""<types>
<type id="driving" priority="1" speed="{SPEED_M_S}" width="3.5" disallow="{_RAIL_AND_OTHERS}"/>
<type id="biking" priority="0" speed="{SPEED_M_S}" width="1.5" allow="bicycle"/>
<type id="sidewalk" priority="0" speed="2.78" width="2" allow="pedestrian"/>
<type id="walking" priority="0" speed="2.78" width="2" allow="pedestrian"/>
<type id="shoulder" priority="0" speed="1.39" width="1" disallow="all"/>
<type id="border" priority="0" speed="1.39" width="0.1" disallow="all"/>
<type id="median" priority="0" speed="1.39" width="0.1" disallow="all"/>
<type id="curb" priority="0" speed="1.39" width="0.1" disallow="all"/>
<type id="parking" priority="0" speed="1.39" width="2.5" disallow="all"/>
<type id="bidirectional" priority="0" speed="1.39" width="3.5" disallow="all"/>
<type id="none" priority="0" speed="1.39" width="1" disallow="all" discard="true"/>
</types>
"""
"""Who may use a lane, by its type in OpenDRIVE. Lanes for nobody keep the others in their place.
By netconvert's own table sidewalks are left out, or open to cars."""


def convert_opendrive(path: Path, folder: Path) -> TownMap:
    """Convert `path` (`.xodr` or `.xodr.gz`) to a SUMO network in `folder`.

    x and y stay those of OpenDRIVE, but for a map with left-hand traffic, of which the network is
    the mirror image. Cars may turn round at dead ends only; lights adapt to traffic; crossings are
    guessed, and so are sidewalks if the map has none at all.

    Raises:
        ValueError: not OpenDRIVE, or with something that netconvert cannot read; names it, or
            carries netconvert's message.
    """
    root = read_opendrive(path)
    lefthand = drives_left(root, path)
    if lefthand:
        mirror_map(root)
    plain, types, network = (folder / f"town.{end}" for end in ("xodr", "typ.xml", "net.xml"))
    try:
        ElementTree(root).write(plain, encoding="utf-8", xml_declaration=True)
    except RecursionError:
        raise ValueError(f"{path}: not an OpenDRIVE map: nested too deeply") from None
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
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0 or not network.is_file():
        errors = [line for line in done.stderr.splitlines() if line.startswith("Error")]
        message = " ".join((errors or ["Error: no network came out"])[0].split())
        raise ValueError(f"{path}: not an OpenDRIVE map: netconvert: {message}")
    return TownMap(network, mirrored=lefthand)
