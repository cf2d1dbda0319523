"""Which class of the box log a CARLA blueprint belongs to."""

from collections.abc import Mapping
from pathlib import Path

from lidarplace.configuration.yaml import read_yaml_file

BOX_TRUCK_M = (5.2, 2.4, 2.6)
"""Length, width and height over which the paper counts a van as *Van and Cyclist*."""

CLASS_OF: Mapping[str, str] = read_yaml_file(Path(__file__).with_name("classes.yaml"))
"""Blueprints whose class is fixed, whatever their wheels and size."""


def object_class(
    blueprint: str, wheels: int, size: tuple[float, float, float], overrides: Mapping[str, str]
) -> str:
    """Class of an object: "Car", "Cyclist" (the paper's Van and Cyclist), "Pedestrian", or any.

    `overrides` come first, then `CLASS_OF`. What neither names is Pedestrian if it walks, Cyclist
    on two wheels or over `BOX_TRUCK_M` in all three dimensions, and Car otherwise.

    Args:
        blueprint: id such as "vehicle.audi.tt" or "walker.pedestrian.0001".
        wheels: number of wheels; 0 for a walker.
        size: length, width, height, metres.
        overrides: class by blueprint id.
    """
    named = overrides.get(blueprint) or CLASS_OF.get(blueprint)
    if named:
        return named
    if blueprint.startswith("walker."):
        return "Pedestrian"
    large = all(side > limit for side, limit in zip(size, BOX_TRUCK_M, strict=True))
    return "Cyclist" if wheels == 2 or large else "Car"
