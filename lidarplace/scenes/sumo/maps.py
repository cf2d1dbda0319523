"""Where the map of a town comes from: generated, a file, or CARLA's by name."""

import contextlib
import os
from importlib.util import find_spec
from pathlib import Path
from xml.etree.ElementTree import ParseError, iterparse

from lidarplace.scenes.sumo.opendrive import convert_opendrive
from lidarplace.scenes.sumo.settings import GENERATED, MAP_SUFFIXES
from lidarplace.scenes.sumo.town import TownMap, build_town

PACKAGE = "py123d"
"""A package on PyPI that carries CARLA's maps (CC-BY 4.0)."""


def build_network(town: str, seed: int, folder: Path) -> TownMap:
    """SUMO network of `town`, which is named as in `SumoScene.towns`; made in `folder` if need be.

    Raises:
        ImportError: SUMO is not installed.
        ValueError: the map is nowhere to be found, or SUMO cannot read it.
    """
    if town == GENERATED:
        return TownMap(build_town(seed, folder))
    path = find_map(town)
    if path.name.endswith(".net.xml"):
        return TownMap(path, lefthand=_keeps_left(path))
    return convert_opendrive(path, folder)


def _keeps_left(network: Path) -> bool:
    """Whether a SUMO network says so; what is wrong with the file is said by who reads it."""
    with contextlib.suppress(ParseError):
        for _, root in iterparse(network, events=("start",)):
            return bool(root.get("lefthand") == "true")
    return False


def find_map(town: str) -> Path:
    """File of a town that is not generated: its path, or that of the CARLA map of this name.

    Raises:
        ValueError: there is no such file.
    """
    path = Path(town) if town.endswith(MAP_SUFFIXES) else find_carla_map(town)
    if not path.is_file():
        raise ValueError(f"{path}: no such map file")
    return path


def find_carla_map(name: str) -> Path:
    """OpenDRIVE file of the CARLA map `name`, such as Town03.

    Looks in the installed package `py123d`, without importing it, and then in the installation of
    CARLA that the environment variable `CARLA_ROOT` names.

    Raises:
        ValueError: neither has it; says where was looked and how to get it.
    """
    looked = []
    spec = find_spec(PACKAGE)
    if spec is None or not spec.submodule_search_locations:
        looked.append(f"the package {PACKAGE} (not installed)")
    else:
        folder = Path(spec.submodule_search_locations[0]) / "parser" / "opendrive" / "carla_maps"
        path = folder / f"{name}.xodr.gz"
        if path.is_file():
            return path
        looked.append(str(folder))
    root = os.environ.get("CARLA_ROOT")
    if not root:
        looked.append("CARLA_ROOT (not set)")
    else:
        folder = Path(root) / "CarlaUE4" / "Content" / "Carla" / "Maps" / "OpenDrive"
        path = folder / f"{name}.xodr"
        if path.is_file():
            return path
        looked.append(str(folder))
    raise ValueError(
        f"no map {name!r}; looked in {' and '.join(looked)}. CARLA's maps (CC-BY 4.0) come with "
        f"`pip install --no-deps {PACKAGE}`, or with a CARLA whose folder CARLA_ROOT names"
    )
