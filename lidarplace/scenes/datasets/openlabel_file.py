"""Content of an ASAM OpenLABEL 1.0.0 file, as far as cuboids go, and its coordinate systems."""

from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field, model_validator
from scipy.spatial.transform import Rotation

from lidarplace.base.errors import InputError
from lidarplace.configuration.record import Number
from lidarplace.rigs.rotations import rotations, rotations_of

VEHICLE = "local_cs"  # the type of a coordinate system that moves with the vehicle
Matrix = NDArray[np.float64]


def _list_of(length: int) -> Any:
    return Annotated[list[Number], Field(min_length=length, max_length=length)] | None


class Transform(BaseModel):
    """`transform_data`: X_dst = T X_src, in one of three ways to write it."""

    matrix4x4: _list_of(16) = None  # type: ignore[valid-type]
    translation: _list_of(3) = None  # type: ignore[valid-type]
    quaternion: _list_of(4) = None  # type: ignore[valid-type]
    euler_angles: _list_of(3) = None  # type: ignore[valid-type]
    sequence: Annotated[str, Field(pattern="^[XYZ]{3}$")] = "ZYX"

    @model_validator(mode="after")
    def _is_one(self) -> Self:
        turned = self.quaternion is not None or self.euler_angles is not None
        if self.matrix4x4 is None and (self.translation is None or not turned):
            raise InputError(expected="matrix4x4, or translation with quaternion or euler_angles")
        self.matrix()  # raises ValueError unless it is a rotation
        return self

    def matrix(self) -> Matrix:
        """Return the transform as a matrix, (4, 4)."""
        if self.matrix4x4 is not None:
            matrix = np.reshape(self.matrix4x4, (4, 4))
            return _rigid(rotations_of(matrix[:3, :3]), matrix[:3, 3])
        if self.quaternion is not None:
            return _rigid(rotations(self.quaternion), self.translation)
        return _rigid(Rotation.from_euler(self.sequence, self.euler_angles), self.translation)


def _rigid(rotation: Rotation, position: Any) -> Matrix:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation.as_matrix(), position
    return matrix


class Cuboid(BaseModel):
    """`val`: centre, quaternion x, y, z, w or angles about x, y, z, and size; 10 or 9 numbers."""

    val: Annotated[list[Number], Field(min_length=9, max_length=10)]
    coordinate_system: str | None = None

    def pose(self) -> Matrix:
        """Return the pose as a matrix, (4, 4)."""
        turned = self.val[3:-3]
        if len(turned) == 4:
            return _rigid(rotations(turned), self.val[:3])
        return _rigid(Rotation.from_euler("ZYX", turned[::-1]), self.val[:3])

    @model_validator(mode="after")
    def _is_one(self) -> Self:
        if min(self.val[-3:]) < 0:
            raise InputError(expected="sizes of at least 0", found=self.val[-3:])
        self.pose()  # raises ValueError unless the quaternion is a rotation
        return self


class ObjectData(BaseModel):
    """Cuboids of an object."""

    cuboid: list[Cuboid] = []


class Interval(BaseModel):
    """Frames, both ends included."""

    frame_start: int
    frame_end: int


class ObjectOfFrame(BaseModel):
    """An object in one frame."""

    object_data: ObjectData = ObjectData()


class LabelledObject(ObjectOfFrame):
    """An object, in all its frames."""

    type: str
    coordinate_system: str | None = None
    frame_intervals: list[Interval] = []


class FrameTransform(BaseModel):
    """Transform between two coordinate systems, in one frame."""

    src: str
    dst: str
    transform_src_to_dst: Transform


class FrameProperties(BaseModel):
    """Time of a frame, and transforms between coordinate systems in it."""

    timestamp: str | Number | None = None
    transforms: dict[str, FrameTransform] = {}


class Frame(BaseModel):
    """A frame, with the objects that have something of their own in it."""

    frame_properties: FrameProperties = FrameProperties()
    objects: dict[str, ObjectOfFrame] = {}


class CoordinateSystem(BaseModel):
    """Coordinate system; frames may give its pose in the parent, too."""

    type: str
    parent: str = ""
    pose_wrt_parent: Transform | None = None


class Content(BaseModel):
    """Content of the key `openlabel`."""

    coordinate_systems: dict[str, CoordinateSystem] = {}
    objects: dict[str, LabelledObject] = {}
    frames: dict[int, Frame]


class OpenLabel(BaseModel):
    """An OpenLABEL file."""

    openlabel: Content


class Systems:
    """The coordinate systems of one frame, by the transforms that are known between them.

    Those of a frame win over those that hold throughout."""

    def __init__(self, content: Content, frame: Frame) -> None:
        self._known: dict[tuple[str, str], Matrix] = {}
        for name, system in content.coordinate_systems.items():
            if system.pose_wrt_parent is not None:
                self._add(name, system.parent, system.pose_wrt_parent)
        for each in frame.frame_properties.transforms.values():
            self._add(each.src, each.dst, each.transform_src_to_dst)

    def _add(self, src: str, dst: str, transform: Transform) -> None:
        matrix = self._known[src, dst] = transform.matrix()
        self._known[dst, src] = np.asarray(np.linalg.inv(matrix), np.float64)

    def between(self, src: str, dst: str) -> Matrix | None:
        """Chain the fewest known transforms that lead from `src` to `dst`; None if none do."""
        reached: dict[str, Matrix] = {src: np.eye(4)}
        last = [src]
        while last and dst not in reached:
            new = []
            for (a, b), matrix in self._known.items():
                if a in last and b not in reached:
                    reached[b] = matrix @ reached[a]
                    new.append(b)
            last = new
        return reached.get(dst)
