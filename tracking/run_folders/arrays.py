"""Files of arrays of run folders: the writer and the reader go by the same fields."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.files.arrays import check_numbers, read_npz
from lidarplace.files.atomic import replacing
from lidarplace.files.regular import is_there
from lidarplace.requirements.tables import Ground

Arrays = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class ArrayFile:
    """A NumPy archive: a field that is an array under its name, those of a mapping as `field/key`,
    and so on inwards."""

    FILE: ClassVar[str]

    def write(self, folder: Path) -> None:
        """Write all arrays in one step."""
        with replacing(folder / self.FILE) as partial, partial.open("wb") as file:
            np.savez_compressed(file, **dict(_flat(vars(self))))  # type: ignore[arg-type]

    @classmethod
    def read(cls, folder: Path) -> Self | None:
        """None if it is not in `folder`. Raises ValueError that names file and array."""
        path = folder / cls.FILE
        if not is_there(path):
            return None
        arrays = read_npz(path)
        found = {
            field.name: within(arrays, field.name)
            if str(field.type).startswith("dict")
            else arrays.get(field.name)
            for field in fields(cls)
        }
        if missing := [name for name, value in found.items() if value is None]:
            raise ValueError(f"{path} has no array {', '.join(missing)}; found {', '.join(arrays)}")
        whole = cls(**found)
        whole._check(path)
        return whole

    def _check(self, path: Path) -> None:
        """Raise ValueError unless the arrays are of the shapes that the class tells."""
        raise NotImplementedError


def _flat(arrays: Mapping[str, Any], start: str = "") -> Iterator[tuple[str, NDArray[Any]]]:
    for name, value in arrays.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{start}{name}/")
        else:
            yield f"{start}{name}", value


def within(arrays: Arrays, field: str) -> dict[str, NDArray[Any]]:
    """Arrays of the field, a mapping, in the order of the file."""
    start = f"{field}/"
    return {name[len(start) :]: arrays[name] for name in arrays if name.startswith(start)}


@dataclass(frozen=True)
class Maps(ArrayFile):
    """What lies around the vehicle and what placements cover of it, over the ROI.

    From above is by columns of voxels, shape (nx, ny); from the side, seen along y, by rows of
    voxels, shape (nx, nz). All are float32. Older run folders have no residual entropy and nothing
    from the side.

    Attributes:
        pog: by class, the entropy in nats, from above.
        coverage, coverage_side: by placement, the covered share, in [0, 1].
        residual, residual_side: by placement, the entropy of all classes that no beam covers, nats.
    """

    FILE: ClassVar[str] = "maps.npz"

    pog: dict[str, NDArray[np.float32]]
    coverage: dict[str, NDArray[np.float32]]
    coverage_side: dict[str, NDArray[np.float32]]
    residual: dict[str, NDArray[np.float32]]
    residual_side: dict[str, NDArray[np.float32]]

    def _check(self, path: Path) -> None:
        for field, arrays in vars(self).items():
            for name, array in arrays.items():
                check_numbers(f"{field}/{name}", array, 2, path)


@dataclass(frozen=True)
class Frame(ArrayFile):
    """One frame as every placement sees it, in the ego frame.

    Attributes:
        boxes: ground truth x, y, z, length, width, height, yaw, shape (m, 7), float64.
        labels: class of every box, shape (m,), str.
        points: by placement, x, y, z in metres and intensity, shape (n, 4), float32.
        lidar: by placement, the mount that each point comes from, shape (n,), uint8.
    """

    FILE: ClassVar[str] = "frame.npz"

    boxes: NDArray[np.float64]
    labels: NDArray[np.str_]
    points: dict[str, NDArray[np.float32]]
    lidar: dict[str, NDArray[np.uint8]]

    def _check(self, path: Path) -> None:
        check_numbers("boxes", self.boxes, 2, path)
        if self.boxes.shape[1] != 7 or self.labels.shape != self.boxes.shape[:1]:
            raise ValueError(
                f"{path}: boxes need 7 numbers and a label each, found {self.boxes.shape} and "
                f"{self.labels.shape} labels"
            )
        if self.labels.dtype.kind != "U":
            raise ValueError(f"{path}: labels must hold text, found {self.labels.dtype}")
        if set(self.points) != set(self.lidar):
            raise ValueError(
                f"{path}: points of {', '.join(self.points)}, but lidar of {', '.join(self.lidar)}"
            )
        for name, points in self.points.items():
            check_numbers(f"points/{name}", points, 2, path)
            check_numbers(f"lidar/{name}", self.lidar[name], 1, path)
            if points.shape != (len(self.lidar[name]), 4):
                raise ValueError(
                    f"{path}: points/{name} needs 4 numbers for each of {len(self.lidar[name])} "
                    f"points, found shape {points.shape}"
                )


@dataclass(frozen=True)
class FailureFrames(ArrayFile):
    """Frames that tell which objects one rig found and another one missed.

    Attributes:
        rigs: the two placements, shape (2,), str.
        objects: number in `objects.parquet` of the object that each frame is shown for, shape (n,),
            int64.
        points: by place in `objects` and in `rigs`, as `0/1`, x, y, z in metres of a thinned cloud
            that has all points on objects, shape (p, 3), float32.
        detections: alike, x, y, z, length, width, height, yaw and score of the lowest seed's, shape
            (d, 8), float64.
    """

    FILE: ClassVar[str] = "failures.npz"

    rigs: NDArray[np.str_]
    objects: NDArray[np.int64]
    points: dict[str, NDArray[np.float32]]
    detections: dict[str, NDArray[np.float64]]

    def are_of(self, rigs: tuple[str, str], objects: pd.Series) -> bool:
        """Whether they show objects of these numbers under these two rigs, in this order."""
        return self.rigs.tolist() == [*rigs] and bool(np.isin(self.objects, objects).all())

    def _check(self, path: Path) -> None:
        if self.rigs.shape != (2,) or self.rigs.dtype.kind != "U":
            raise ValueError(f"{path}: rigs must hold two names, found {self.rigs!r}")
        check_numbers("objects", self.objects, 1, path)
        places = [f"{place}/{rig}" for place in range(len(self.objects)) for rig in range(2)]
        for field, width in (("points", 3), ("detections", 8)):
            own = getattr(self, field)
            for place in places:
                if place not in own:
                    raise ValueError(f"{path} has no array {field}/{place}")
                check_numbers(f"{field}/{place}", own[place], 2, path)
                if own[place].shape[1] != width:
                    raise ValueError(
                        f"{path}: {field}/{place} needs {width} columns, found shape "
                        f"{own[place].shape}"
                    )


@dataclass(frozen=True)
class UnseenMaps(ArrayFile):
    """Entropy of each column of voxels, nats, shape (nx, ny), float32.

    Attributes:
        pog: by class, all of it.
        unseen: by class and rig, that of the voxels which no beam covers.
    """

    FILE: ClassVar[str] = "maps.npz"

    pog: dict[str, NDArray[np.float32]]
    unseen: dict[str, dict[str, NDArray[np.float32]]]

    @classmethod
    def read(cls, folder: Path) -> UnseenMaps:
        """Without any map if they are not in `folder`. Raises ValueError that names file and
        array."""
        path = folder / cls.FILE
        arrays = read_npz(path) if is_there(path) else {}
        for name, array in arrays.items():
            check_numbers(name, array, 2, path)
        pog, unseen = within(arrays, "pog"), within(arrays, "unseen")
        classes = dict.fromkeys(name.partition("/")[0] for name in unseen)
        return cls(pog, {name: within(unseen, name) for name in classes})


@dataclass(frozen=True)
class Grounds(ArrayFile):
    """What every place around the vehicle has of what is required there; see `Ground`.

    Attributes:
        body: `lidarplace.mounting.outline.outline` of the vehicle, metres, shape (n, 2), float64.
        names: the requirements, shape (r,), str.
        x, y: by number of the requirement, middles of cells, metres, shapes (nx,) and (ny,),
            float64.
        least: by that number and the rig, as `0/line`, shape (nx, ny), float32.
    """

    FILE: ClassVar[str] = "requirements.npz"

    body: NDArray[np.float64]
    names: NDArray[np.str_]
    x: dict[str, NDArray[np.float64]]
    y: dict[str, NDArray[np.float64]]
    least: dict[str, NDArray[np.float32]]

    @classmethod
    def of(
        cls, body: NDArray[np.float64], names: Sequence[str], by_rig: Mapping[str, Sequence[Ground]]
    ) -> Grounds:
        """Those of each rig, in the order of the requirements' `names`."""
        found = cls(body, np.array(names), {}, {}, {})
        for rig, grounds in by_rig.items():
            for number, ground in enumerate(grounds):
                found.x[str(number)], found.y[str(number)] = ground.x, ground.y
                found.least[f"{number}/{rig}"] = ground.least.astype(np.float32)
        return found

    def under(self, rig: str, requirement: str) -> Ground | None:
        """The ground of a requirement under a rig; None if it is not kept."""
        names = self.names.tolist()
        number = str(names.index(requirement)) if requirement in names else ""
        least = self.least.get(f"{number}/{rig}")
        if least is None:
            return None
        return Ground(self.x[number], self.y[number], least.astype(np.float64))

    def _check(self, path: Path) -> None:
        check_numbers("body", self.body, 2, path)
        if self.body.shape[1:] != (2,):
            raise ValueError(f"{path}: body needs x and y of each corner, found {self.body.shape}")
        if self.names.ndim != 1 or self.names.dtype.kind != "U":
            raise ValueError(f"{path}: names must hold text, found {self.names.dtype}")
        for number in map(str, range(len(self.names))):
            for field in ("x", "y"):
                own = getattr(self, field)
                if number not in own:
                    raise ValueError(f"{path} has no array {field}/{number}")
                check_numbers(f"{field}/{number}", own[number], 1, path)
        for name, least in self.least.items():
            check_numbers(f"least/{name}", least, 2, path)
            number = name.partition("/")[0]
            if number not in self.x or least.shape != (len(self.x[number]), len(self.y[number])):
                raise ValueError(f"{path}: least/{name} is no grid of x and y, its {least.shape}")
