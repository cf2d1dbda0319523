"""The mapping of a label file: columns, units, origin, classes, frames and drives."""

from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from lidarplace.base.class_names import check_class_name
from lidarplace.base.errors import InputError
from lidarplace.configuration.settings import FileBeside, Length, Name, Settings, excerpt, validated
from lidarplace.configuration.yaml import read_yaml_file
from lidarplace.logs.boxes import CLASSES
from lidarplace.logs.plausibility import LogCheck
from lidarplace.scenes.label_tables.units import AngleUnit, LengthUnit, TimeUnit

Value = Annotated[Name, BeforeValidator(lambda value: str(value) if type(value) is int else value)]
"""Value of a column: text, or a number that names something."""


class Columns(Settings):
    """Names of columns."""

    drive: Name | None = Field(None, description="of recordings, which become scenes and routes")
    time: Name | None = Field(None, description="of time stamps; this or `frame`")
    frame: Name | None = Field(None, description="of frame numbers, each drive has its own")
    object: Name | None = Field(None, description="of ids that an object has in all its frames")
    category: Name = Field(description="of the class")
    x: Name = Field(description="forward, or east in the world")
    y: Name = Field(description="to the left, or north")
    z: Name = Field(description="up")
    length: Name = Field(description="along the box's own x axis")
    width: Name = Field(description="along its y axis")
    height: Name = Field(description="along its z axis")
    yaw: Name = Field(description="about z, from the x axis towards y")
    points: Name | None = Field(None, description="of the number of real points in a box")

    @model_validator(mode="before")
    @classmethod
    def _named(cls, columns: Any) -> Any:
        for name, field in cls.model_fields.items():
            if isinstance(columns, dict) and columns.get(name, "") is None and field.is_required():
                fix = "name one, or add it to the file"
                if name == "yaw":
                    fix += "; a quaternion about z is the yaw 2 atan2(qz, qw)"
                raise InputError(key=name, expected="a column", found="no name", fix=fix)
        return columns

    @model_validator(mode="after")
    def _one_of_both(self) -> Self:
        if (self.time is None) == (self.frame is None):
            both = "neither" if self.time is None else "both"
            raise InputError(expected="one of `time` and `frame`", found=both)
        return self


class Units(Settings):
    """Units of the columns."""

    position: LengthUnit = Field("m", description="of x, y and z")
    size: LengthUnit = Field("m", description="of length, width and height")
    angle: AngleUnit = Field("rad", description="of yaw")
    time: TimeUnit = Field("s", description="of time stamps")


class Origin(Settings):
    """Origin of the label file's vehicle frame in our ego frame, metres.

    Ours is on the ground under the centre of the vehicle. A rear axle 1.4 m behind the centre and
    0.33 m above the ground is x: -1.4, z: 0.33."""

    x: Length = Field(0.0, description="ahead of the centre; < 0 behind it")
    y: Length = Field(0.0, description="left of it")
    z: Length = Field(0.0, description="above the ground")


class EgoPoses(Settings):
    """Poses of the vehicle in the world: columns of the label file, or of a file of their own."""

    file: FileBeside | None = Field(
        None,
        description="CSV or Parquet, from the folder of this mapping; by default the label file",
    )
    drive: Name | None = Field(None, description="of that file, if named differently there")
    stamp: Name | None = Field(None, description="likewise: time stamps, or frame numbers")
    x: Name = Field(description="east")
    y: Name = Field(description="north")
    z: Name | None = Field(None, description="up; by default 0")
    yaw: Name = Field(description="about z, from the x axis towards y")
    position: LengthUnit = Field("m", description="unit of x, y and z")
    angle: AngleUnit | None = Field(None, description="unit of yaw; by default `units.angle`")


class FrameRate(Settings):
    """Rate of the frames."""

    rate_hz: float | None = Field(
        None,
        gt=0,
        le=1000,
        description="a frame every 1 / rate_hz seconds from the first to the last box of a drive, "
        "those without a box too; by default only the times (or numbers) that occur",
    )


class Drives(Settings):
    """Split of the drives; without any all are for training."""

    train: tuple[Value, ...] | None = Field(None, description="by default all others")
    test: tuple[Value, ...] = Field(
        (), description="these POGs leave out, and detectors are tested on"
    )

    @model_validator(mode="after")
    def _in_one_split(self) -> Self:
        if both := [name for name in self.test if name in (self.train or ())]:
            raise InputError(f"drive {both[0]!r} is in train and in test")
        return self


class TableMapping(Settings):
    """Meaning of the columns of a label file."""

    columns: Columns
    units: Units = Units()
    box_z: Literal["centre", "bottom"] = Field(
        "centre", description="reference point of z of a box"
    )
    coordinates: Literal["ego", "world"] = Field(
        "ego", description="of boxes: in the vehicle's frame, or in the world's, with `poses`"
    )
    origin: Origin = Origin()
    poses: EgoPoses | None = None
    classes: dict[Value, str | None] = Field(
        description=f"category: class, {', '.join(CLASSES)} or any name, or null to leave it out"
    )
    frames: FrameRate = FrameRate()
    drives: Drives = Drives()
    accept: tuple[LogCheck, ...] = Field(
        (), description="checks to skip, for values that are correct although they look implausible"
    )

    @model_validator(mode="after")
    def _whole(self) -> Self:
        for category, name in self.classes.items():
            if name is not None:
                check_class_name(name, key=f"classes.{category}", fix="null ignores its boxes")
        if self.coordinates == "world" and self.poses is None:
            raise InputError("world needs `poses` of the vehicle", key="coordinates")
        if self.columns.drive is None and (self.drives.test or self.drives.train):
            raise InputError("need `columns.drive`", key="drives")
        return self

    @property
    def stamp(self) -> str:
        """The column that distinguishes frames."""
        return self.columns.time or self.columns.frame or ""

    def column(self, name: str) -> str:
        """Return the file's own name of a column of boxes, or of the vehicle's pose."""
        if name.startswith("ego_"):
            return str(getattr(self.poses, name.removeprefix("ego_")))
        return self.stamp if name == "timestamp_s" else str(getattr(self.columns, name))


def read_mapping(path: Path) -> TableMapping:
    """Read the keys of `TableMapping`; raise OSError, and ValueError that names file and key."""
    content = read_yaml_file(path)
    if not isinstance(content, dict):
        raise InputError(place=path, expected="keys such as `columns`", found=excerpt(content))
    return validated(TableMapping, content, str(path), path.parent)
