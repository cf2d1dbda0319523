"""Presets: the zone of a regulation around a vehicle, and its requirements, from a file."""

from functools import cache
from importlib.resources import files
from typing import Any, Literal

import yaml
from pydantic import Field

from lidarplace.base.errors import InputError
from lidarplace.configuration.settings import Length, Settings, Text
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.requirements.area import Area

PRESETS = ("fmvss_111", "un_r151", "un_r158", "un_r159", "un_r167")

End = tuple[Literal["front", "rear", "left", "right", "middle"], Length]
"""An end of the vehicle's body, or its middle line, and metres from there along the axis."""


class AreaFile(Settings):
    """A rectangle around the vehicle."""

    x: tuple[End, End]  # from the rear to the front
    y: tuple[End, End]  # from the right to the left


class NumberFile(Settings):
    """A number of the text."""

    value: float  # metres
    meaning: Text = Field(alias="is")
    paragraph: Text  # of the text
    checked: bool  # whether it was compared with the text


class PresetFile(Settings):
    """A regulation's zone."""

    about: Text
    text: Text  # the regulation
    vehicles: Text  # categories to which it applies
    area: AreaFile  # where the middle of the object may be
    numbers: tuple[NumberFile, ...] = Field(min_length=1)
    leaves_out: tuple[Text, ...] = Field(min_length=1)  # what our model of it does not have
    requirements: tuple[dict[str, Any], ...] = Field(min_length=1)  # as in a file of them


@cache
def preset_file(name: str) -> PresetFile:
    """Read a preset. Raises ValueError: there is none of that name."""
    if name not in PRESETS:
        raise InputError(expected=", ".join(PRESETS), found=repr(name))
    text = files(__package__).joinpath(f"{name}.yaml").read_text(encoding="utf-8")
    return PresetFile.model_validate(yaml.safe_load(text))


def preset(name: str, vehicle: Vehicle) -> Area:
    """Return the area of a preset around this vehicle. Raises ValueError: it has no body."""
    area, extents = preset_file(name).area, vehicle.body.extents
    if not len(extents):
        raise InputError(key="where.preset", expected=f"a vehicle with a body, for {name}")
    rear, right, _ = extents[:, 0].min(axis=0).tolist()
    front, left, _ = extents[:, 1].max(axis=0).tolist()
    ends = {"front": front, "rear": rear, "left": left, "right": right}
    ends["middle"] = (left + right) / 2
    (x0, x1), (y0, y1) = ([ends[end] + by for end, by in axis] for axis in (area.x, area.y))
    return Area(x=(x0, x1), y=((y0, y1),))
