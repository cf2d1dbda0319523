"""Files of arrays of run folders: the writer and the reader go by the same fields."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.errors import InputError, at
from lidarplace.files.arrays import read_npz
from lidarplace.files.atomic import replacing
from lidarplace.files.regular import is_there
from lidarplace.requirements.tables import Ground

Arrays = Mapping[str, NDArray[Any]]


def axes(*lengths: int | None) -> dict[str, tuple[int | None, ...]]:
    """Make the metadata of a field whose arrays have these axes; None: of any length."""
    return {"axes": lengths}


@dataclass(frozen=True)
class ArrayFile:
    """NumPy archive: a field that is an array under its name, those of a mapping as `field/key`.

    The metadata of a field are the `axes` of its arrays."""

    FILE: ClassVar[str]

    def write(self, folder: Path) -> None:
        """Write all arrays in one step."""
        with replacing(folder / self.FILE) as partial, partial.open("wb") as file:
            np.savez_compressed(file, **dict(_flat(vars(self))))  # type: ignore[arg-type]

    @classmethod
    def read(cls, folder: Path) -> Self | None:
        """Read the file in `folder`; None if it is missing.

        Raises ValueError that names file and array."""
        path = folder / cls.FILE
        if not is_there(path):
            return None
        arrays = read_npz(path)
        kinds = {description.name: str(description.type) for description in fields(cls)}
        arrays_by_field = {
            name: within(arrays, name) if kind.startswith("dict") else arrays.get(name)
            for name, kind in kinds.items()
        }
        if missing := [name for name, value in arrays_by_field.items() if value is None]:
            names = ", ".join(arrays)
            raise InputError("missing array", place=path, key=", ".join(missing), found=names)
        whole = cls(**arrays_by_field)
        with at(path):
            whole._check()
        return whole

    def _check(self) -> None:
        """Raise ValueError unless all arrays have the shapes and kinds of the class."""
        by_name = {description.name: description for description in fields(self)}
        for name, array in _flat(vars(self)):
            description = by_name[name.partition("/")[0]]
            wanted = description.metadata["axes"]
            kinds, holds = (
                ("U", "text") if "np.str_" in str(description.type) else ("iuf", "numbers")
            )
            if array.dtype.kind not in kinds:
                raise InputError(key=name, expected=holds, found=array.dtype)
            pairs = zip(wanted, array.shape, strict=False)
            if array.ndim != len(wanted) or any(n not in (None, size) for n, size in pairs):
                shape = ", ".join("n" if n is None else str(n) for n in wanted)
                raise InputError(key=name, expected=f"shape ({shape})", found=array.shape)


def _flat(arrays: Mapping[str, Any], start: str = "") -> Iterator[tuple[str, NDArray[Any]]]:
    for name, value in arrays.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{start}{name}/")
        else:
            yield f"{start}{name}", value


def within(arrays: Arrays, field: str) -> dict[str, NDArray[Any]]:
    """Select the arrays of a field that is a mapping, in the order of the file."""
    start = f"{field}/"
    return {name[len(start) :]: arrays[name] for name in arrays if name.startswith(start)}


_PLANE = axes(None, None)


@dataclass(frozen=True)
class Maps(ArrayFile):
    """Entropy around the vehicle and what placements cover of it, over the ROI.

    By columns of voxels, shape (nx, ny), float32. Older run folders have no residual entropy.

    Attributes:
        pog: by class, the entropy in nats, from above.
        coverage: by placement, the covered share, in [0, 1].
        residual: by placement, the entropy of all classes that no beam covers, nats."""

    FILE: ClassVar[str] = "maps.npz"

    pog: dict[str, NDArray[np.float32]] = field(metadata=_PLANE)
    coverage: dict[str, NDArray[np.float32]] = field(metadata=_PLANE)
    residual: dict[str, NDArray[np.float32]] = field(metadata=_PLANE)

    def _check(self) -> None:
        super()._check()
        if missing := sorted(self.residual.keys() - self.coverage.keys()):
            raise InputError("missing array", key=f"coverage/{missing[0]}")


@dataclass(frozen=True)
class Frame(ArrayFile):
    """Frame as every placement sees it, in the ego frame.

    Attributes:
        boxes: ground truth x, y, z, length, width, height, yaw, shape (m, 7), float64.
        labels: class of every box, shape (m,), str.
        points: by placement, x, y, z in metres and intensity, shape (n, 4), float32.
        lidar: by placement, the mount that each point comes from, shape (n,), uint8."""

    FILE: ClassVar[str] = "frame.npz"

    boxes: NDArray[np.float64] = field(metadata=axes(None, 7))
    labels: NDArray[np.str_] = field(metadata=axes(None))
    points: dict[str, NDArray[np.float32]] = field(metadata=axes(None, 4))
    lidar: dict[str, NDArray[np.uint8]] = field(metadata=axes(None))

    def _check(self) -> None:
        super()._check()
        if (boxes := len(self.boxes)) != len(self.labels):
            raise InputError(key="labels", expected=f"{boxes}, one per box", found=len(self.labels))
        for name in {**self.points, **self.lidar}:
            points, lidar = (len(arrays.get(name, ())) for arrays in (self.points, self.lidar))
            if points != lidar:
                wanted = f"{points}, one per point"
                raise InputError(key=f"lidar/{name}", expected=wanted, found=lidar)


@dataclass(frozen=True)
class FailureFrames(ArrayFile):
    """Frames that show which objects one rig found and another one missed.

    Attributes:
        rigs: the two placements, shape (2,), str.
        objects: number in `objects.parquet` of the object that each frame is shown for, shape (n,),
            int64.
        points: by place in `objects` and in `rigs`, as `0/1`, x, y, z in metres of a thinned cloud
            that has all points on objects, shape (p, 3), float32.
        detections: alike, x, y, z, length, width, height, yaw and score of the lowest seed's, shape
            (d, 8), float64."""

    FILE: ClassVar[str] = "failures.npz"

    rigs: NDArray[np.str_] = field(metadata=axes(2))
    objects: NDArray[np.int64] = field(metadata=axes(None))
    points: dict[str, NDArray[np.float32]] = field(metadata=axes(None, 3))
    detections: dict[str, NDArray[np.float64]] = field(metadata=axes(None, 8))

    def are_of(self, rigs: tuple[str, str], objects: pd.Series) -> bool:
        """Tell whether they show objects of these numbers under these two rigs, in this order."""
        return self.rigs.tolist() == [*rigs] and bool(np.isin(self.objects, objects).all())

    def _check(self) -> None:
        super()._check()
        places = {f"{place}/{rig}" for place in range(len(self.objects)) for rig in range(2)}
        for kind in ("points", "detections"):
            if missing := sorted(places - getattr(self, kind).keys()):
                raise InputError("missing array", key=f"{kind}/{missing[0]}")


@dataclass(frozen=True)
class UnseenMaps(ArrayFile):
    """Entropy of each column of voxels, nats, shape (nx, ny), float32.

    Attributes:
        pog: by class, all of it.
        unseen: by class and rig, that of the voxels which no beam covers."""

    FILE: ClassVar[str] = "maps.npz"

    pog: dict[str, NDArray[np.float32]] = field(metadata=_PLANE)
    unseen: dict[str, dict[str, NDArray[np.float32]]] = field(metadata=_PLANE)

    @classmethod
    def read(cls, folder: Path) -> UnseenMaps:
        """Read the maps in `folder`, none if the file is missing; raises ValueError as others."""
        maps = super().read(folder) or cls({}, {})
        unseen = dict(_flat(maps.unseen))
        classes = dict.fromkeys(name.partition("/")[0] for name in unseen)
        return cls(maps.pog, {name: within(unseen, name) for name in classes})


@dataclass(frozen=True)
class Grounds(ArrayFile):
    """Values of every place around the vehicle relative to a requirement; see `Ground`.

    Attributes:
        body: `lidarplace.mounting.outline.outline` of the vehicle, metres, shape (n, 2), float64.
        names: the requirements, shape (r,), str.
        x, y: by number of the requirement, centres of cells, metres, shapes (nx,) and (ny,),
            float64.
        least: by that number and the rig, as `0/line`, shape (nx, ny), float32."""

    FILE: ClassVar[str] = "requirements.npz"

    body: NDArray[np.float64] = field(metadata=axes(None, 2))
    names: NDArray[np.str_] = field(metadata=axes(None))
    x: dict[str, NDArray[np.float64]] = field(metadata=axes(None))
    y: dict[str, NDArray[np.float64]] = field(metadata=axes(None))
    least: dict[str, NDArray[np.float32]] = field(metadata=_PLANE)

    @classmethod
    def of(
        cls, body: NDArray[np.float64], names: Sequence[str], by_rig: Mapping[str, Sequence[Ground]]
    ) -> Grounds:
        """Collect the grounds of each rig, in the order of the requirements' `names`."""
        collected = cls(body, np.array(names), {}, {}, {})
        for rig, grounds in by_rig.items():
            for number, ground in enumerate(grounds):
                collected.x[str(number)], collected.y[str(number)] = ground.x, ground.y
                collected.least[f"{number}/{rig}"] = ground.least.astype(np.float32)
        return collected

    def under(self, rig: str, requirement: str) -> Ground | None:
        """Return the ground of a requirement under a rig; None if it is not kept."""
        names = self.names.tolist()
        number = str(names.index(requirement)) if requirement in names else ""
        least = self.least.get(f"{number}/{rig}")
        if least is None:
            return None
        return Ground(self.x[number], self.y[number], least.astype(np.float64))

    def _check(self) -> None:
        super()._check()
        for name, least in self.least.items():
            sides = tuple(len(axis.get(name.partition("/")[0], ())) for axis in (self.x, self.y))
            if least.shape != sides:
                wanted = f"shape {sides}, that of x and y"
                raise InputError(key=f"least/{name}", expected=wanted, found=least.shape)
