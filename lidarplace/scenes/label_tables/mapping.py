"""The mapping of a label file: columns, units, origin, classes, frames and drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from lidarplace.base.class_names import check_class_name
from lidarplace.base.errors import InputError, at
from lidarplace.configuration.settings import (
    Angle,
    FileBeside,
    Length,
    Name,
    Settings,
    excerpt,
    validated,
)
from lidarplace.configuration.yaml import read_yaml_file
from lidarplace.logs.boxes import CLASSES
from lidarplace.logs.convention import (
    CARLA_AXES,
    Axis,
    Convention,
    Sense,
    Zero,
    anchor_of,
    forward_axis,
)
from lidarplace.logs.plausibility import LogCheck
from lidarplace.scenes.label_tables.units import METRES, RADIANS, AngleUnit, LengthUnit, TimeUnit

OR = " or "  # between candidates of an anchor, of which a proposal could not decide
Value = Annotated[Name, BeforeValidator(lambda value: str(value) if type(value) is int else value)]
"""Value of a column: text, or a number that names something."""


class Direction(Settings):
    """Columns of a vector along the front."""

    x: Name
    y: Name
    z: Name | None = None


class Quaternion(Settings):
    """Columns of a rotation, of length 1."""

    x: Name
    y: Name
    z: Name
    w: Name


def _anchor(words: str) -> str:
    for candidate in words.split(OR):
        anchor_of(candidate)
    return words


class Heading(Settings):
    """Columns of a heading: one of three ways to write it."""

    yaw: Name | None = Field(None, description="of angles about the upright axis, see `yaw`")
    quaternion: Quaternion | None = Field(None, description="in place of yaw: x, y, z and w")
    direction: Direction | None = Field(None, description="in place of yaw: x, y and maybe z")

    @model_validator(mode="after")
    def _one_heading(self) -> Self:
        ways = (self.yaw, self.quaternion, self.direction)
        if (number := sum(way is not None for way in ways)) != 1:
            fix = (
                "write the column of yaw, or replace `yaw` by `quaternion: {x: …, y: …, z: …, w: …}"
            )
            fix += "` or `direction: {x: …, y: …}`"
            expected = "one of yaw, quaternion and direction"
            raise InputError(key="yaw", expected=expected, found=number or "none", fix=fix)
        return self


class Columns(Heading):
    """Names of columns."""

    drive: Name | None = Field(None, description="of recordings, which become scenes and routes")
    time: Name | None = Field(None, description="of time stamps; this or `frame`")
    frame: Name | None = Field(None, description="of frame numbers, each drive has its own")
    object: Name | None = Field(None, description="of ids that an object has in all its frames")
    category: Name = Field(description="of the class")
    x: Name = Field(description="along the first of `axes`")
    y: Name = Field(description="along the second")
    z: Name = Field(description="along the third")
    length: Name = Field(description="from the rear to the front of a box")
    width: Name = Field(description="across")
    height: Name = Field(description="upwards")
    points: Name | None = Field(None, description="of the number of real points in a box")

    @model_validator(mode="before")
    @classmethod
    def _named(cls, columns: Any) -> Any:
        for name, field in cls.model_fields.items():
            if isinstance(columns, dict) and columns.get(name, "") is None and field.is_required():
                fix = f"write the column's name: `{name}: NAME`, or add it to the file"
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
    time: TimeUnit = Field("s", description="of time stamps; iso: dates of ISO 8601")


class Axes(Settings):
    """Directions of the file's axes, seen from the vehicle."""

    x: Axis = "forward"
    y: Axis = "left"
    z: Axis = "up"


class Yaw(Settings):
    """Meaning of yaw."""

    zero: Zero = Field("x", description="axis of the file that the front points along at yaw 0")
    sense: Sense | None = Field(
        None, description="seen from above; by default from x to y, if z is upright"
    )

    @property
    def is_open(self) -> bool:
        """Whether the key `sense` is there without a value: a proposal could not decide it."""
        return self.sense is None and "sense" in self.model_fields_set


class Origin(Settings):
    """Pose of the label file's vehicle frame in our ego frame, metres and radians.

    Ours is on the ground under the centre of the vehicle. A rear axle 1.4 m behind the centre and
    0.33 m above the ground is x: -1.4, z: 0.33."""

    x: Length = Field(0.0, description="ahead of the centre; < 0 behind it")
    y: Length = Field(0.0, description="left of it")
    z: Length = Field(0.0, description="above the ground")
    yaw: Angle = Field(0.0, description="from our x axis to its forward axis, > 0 to the left")

    @property
    def xyz(self) -> tuple[float, float, float]:
        """Place of the origin, metres."""
        return self.x, self.y, self.z


class EgoPoses(Heading):
    """Poses of the vehicle in the world: columns of the label file, or of a file of their own."""

    file: FileBeside | None = Field(
        None,
        description="CSV or Parquet, from the folder of this mapping; by default the label file",
    )
    drive: Name | None = Field(None, description="of that file, if named differently there")
    stamp: Name | None = Field(None, description="likewise: time stamps, or frame numbers")
    x: Name = Field(description="in the world, in its axes")
    y: Name = Field(description="likewise")
    z: Name | None = Field(None, description="by default 0")
    position: LengthUnit = Field("m", description="unit of x, y and z")
    angle: AngleUnit | None = Field(None, description="unit of yaw; by default `units.angle`")
    axes: Axes | None = Field(None, description="of the world; by default as of the boxes")
    zero: Zero | None = Field(
        None,
        description="axis of the world that the vehicle heads along at yaw 0; by default "
        "the one that `axes` call forward",
    )
    sense: Sense | None = Field(None, description="of yaw, seen from above; as `yaw.sense`")


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
    convention: Literal["ego", "carla"] = Field(
        "ego", description="carla: y to the right, for `axes`; sizes there are `half`"
    )
    axes: Axes = Axes()
    yaw: Yaw = Yaw()
    size: Literal["full", "half"] = Field("full", description="half: from the centre to a side")
    anchor: Annotated[str, AfterValidator(_anchor)] = Field(
        "centre", description="point of a box at x, y, z: centre, bottom, or rear left bottom"
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

    @model_validator(mode="before")
    @classmethod
    def _renamed(cls, mapping: Any) -> Any:
        if isinstance(mapping, dict) and "box_z" in mapping and "anchor" not in mapping:
            return {"anchor" if key == "box_z" else key: value for key, value in mapping.items()}
        return mapping  # both: box_z is an unknown key

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if self.convention == "carla" and "axes" in self.model_fields_set:
            raise InputError("already decides the axes", key="convention", fix="remove axes")
        self.of_boxes()  # raises ValueError for axes that are none
        with at(key="poses"):
            self.of_poses()
        self._check_upright()
        self._check_sense()
        for category, name in self.classes.items():
            if name is not None:
                check_class_name(name, key=f"classes.{category}", fix="null ignores its boxes")
        if self.coordinates == "world" and self.poses is None:
            raise InputError("world needs `poses` of the vehicle", key="coordinates")
        if self.columns.drive is None and (self.drives.test or self.drives.train):
            raise InputError("need `columns.drive`", key="drives")
        return self

    def _check_upright(self) -> None:
        """Raise ValueError for vectors of two columns that lack one along the ground."""
        vectors = [("columns.direction.z", self.columns.direction, self.of_boxes())]
        if self.poses is not None:
            of_poses = self.of_poses()
            vectors.append(("poses.direction.z", self.poses.direction, of_poses))
            vectors.append(
                ("poses.z", Direction(x=self.poses.x, y=self.poses.y, z=self.poses.z), of_poses)
            )
        for key, vector, convention in vectors:
            lacks_z = vector is not None and vector.z is None
            if lacks_z and convention.axes[2] not in ("up", "down"):
                raise InputError(key=key, expected="a column: z is not upright", found="none")

    def _check_sense(self) -> None:
        """Raise ValueError for a sense of yaw where no heading is an angle."""
        poses = self.poses
        of_poses = poses is not None and poses.yaw is not None and poses.sense is None
        used = self.columns.yaw is not None or of_poses
        senses = [("yaw.sense", self.yaw.sense if not used else None)]
        senses.append(("poses.sense", poses.sense if poses and poses.yaw is None else None))
        for key, sense in senses:
            if sense is not None:
                fix = "remove it: quaternions and directions have no sense of their own"
                raise InputError("applies only to a column yaw", key=key, found=sense, fix=fix)

    @property
    def stamp(self) -> str:
        """The column that distinguishes frames."""
        return self.columns.time or self.columns.frame or ""

    def candidates(self) -> dict[str, TableMapping]:
        """Return this mapping, or each value of an open key with the mapping that it makes.

        Open are `yaw.sense` without a value, and an `anchor` of several."""
        if not self.yaw.is_open:
            anchors = self.anchor.split(OR)
            copies = (self.model_copy(update={"anchor": anchor}) for anchor in anchors)
            return dict(zip(anchors, copies, strict=True))
        return {
            sense: self.model_copy(update={"yaw": Yaw(zero=self.yaw.zero, sense=sense)})
            for sense in get_args(Sense)
        }

    @property
    def stamp_unit(self) -> TimeUnit | None:
        """Unit of the column that distinguishes frames; None for their numbers."""
        return self.units.time if self.columns.time is not None else None

    def of_boxes(self) -> Convention:
        """Return the convention of boxes."""
        radians = RADIANS[self.units.angle]
        convention = Convention.of(self._axes, self.yaw.zero, self.yaw.sense, radians)
        size = METRES[self.units.size] * (2.0 if self.size == "half" else 1.0)
        metres, anchor = METRES[self.units.position], anchor_of(self.anchor.split(OR)[0])
        return replace(convention, metres=metres, size=size, anchor=anchor)

    def of_poses(self) -> Convention:
        """Return the convention of the vehicle's poses."""
        poses = self.poses or EgoPoses(x="x", y="y", yaw="yaw")
        zero, axes = poses.zero or forward_axis(self._axes), self._axes
        if poses.axes is not None:
            axes = (poses.axes.x, poses.axes.y, poses.axes.z)
        radians = RADIANS[poses.angle or self.units.angle]
        convention = Convention.of(axes, zero, poses.sense or self.yaw.sense, radians)
        return replace(convention, metres=METRES[poses.position])

    @property
    def _axes(self) -> tuple[Axis, Axis, Axis]:
        of_file = (self.axes.x, self.axes.y, self.axes.z)
        return CARLA_AXES if self.convention == "carla" else of_file

    def column(self, name: str) -> str:
        """Return the file's own name of a column of boxes, or of the vehicle's pose."""
        columns = self.poses if name.startswith("ego_") else self.columns
        if name == "timestamp_s":
            return self.stamp
        assert columns is not None
        name = name.removeprefix("ego_")
        keys = ("yaw", "quaternion", "direction") if name == "yaw" else (name,)
        return ", ".join(names_in(columns, *keys).values())


def convention_keys(convention: Convention, mapping: TableMapping) -> str:
    """Write the keys that put boxes of `mapping` in another convention, and leave its poses."""
    keys = f"axes: {_flow(convention.axes)}, " if convention.axes != mapping.of_boxes().axes else ""
    if keys and mapping.poses is not None:
        poses = mapping.of_poses()
        keys += f"poses.axes: {_flow(poses.axes)}, poses.zero: {poses.zero}, "
        keys += f"poses.sense: {poses.sense}, " if mapping.poses.yaw is not None else ""
    sense = f", sense: {convention.sense}" if mapping.columns.yaw is not None else ""
    keys += f"yaw: {{zero: {convention.zero}{sense}}}"
    unit: AngleUnit = "deg" if abs(convention.factor) < 0.1 else "rad"
    return keys + (f", units.angle: {unit}" if unit != mapping.units.angle else "")


def _flow(axes: Sequence[Axis]) -> str:
    return "{" + ", ".join(f"{axis}: {way}" for axis, way in zip("xyz", axes, strict=True)) + "}"


def names_in(columns: Heading, *keys: str) -> dict[str, str]:
    """Return the names of these columns, all without keys, by their key: `quaternion.w`."""
    names: dict[str, str] = {}
    for key in keys or type(columns).model_fields:
        value = getattr(columns, key)
        if isinstance(value, Direction | Quaternion):
            names |= {f"{key}.{axis}": name for axis, name in value if name is not None}
        elif isinstance(value, str) and key not in ("position", "angle", "zero", "sense", "axes"):
            names[key] = value
    return names


def read_mapping(path: Path) -> TableMapping:
    """Read the keys of `TableMapping`; raise OSError, and ValueError that names file and key."""
    content = read_yaml_file(path)
    if not isinstance(content, dict):
        raise InputError(place=path, expected="keys such as `columns`", found=excerpt(content))
    return validated(TableMapping, content, str(path), path.parent)
