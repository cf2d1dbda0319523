"""Typical sizes of a class: the anchors of classes that a preset does not define."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd
from pydantic import TypeAdapter

from lidarplace.base.class_names import counts_of, listed
from lidarplace.base.errors import InputError
from lidarplace.base.suggestions import did_you_mean
from lidarplace.configuration.settings import validated
from lidarplace.logs.boxes import SIZE

Size = tuple[float, float, float]


@dataclass(frozen=True)
class TypicalObject:
    """An object of the size that a class has in the mean."""

    name: str  # of the class
    size: Size  # length, width, height, metres
    bottom: float = 0.0  # height of its underside above the ground, metres

    def __str__(self) -> str:
        sides = " × ".join(f"{side:.2f}" for side in self.size)
        return f"{self.name} {sides} m, {self.bottom:+.2f} m off the ground"


_TYPICAL = TypeAdapter(tuple[TypicalObject, ...])


def typical_objects(boxes: pd.DataFrame, classes: Iterable[str]) -> tuple[TypicalObject, ...]:
    """Compute the typical object of each of `classes`, to the millimetre.

    Sizes are means, as of SECOND's anchors (Yan et al. 2018), over individuals, of which each
    counts once; the height above the ground is the median over boxes. These have class, z, length,
    width, height, ego frame; those with the same `object_id` and `scene`, as far as there are such
    columns, are of one individual.

    Raises ValueError if there is no box of a class, or its boxes have no size."""
    objects = []
    keys = [name for name in ("scene", "object_id") if name in boxes.columns]
    for name in classes:
        of_class = boxes[boxes["class"] == name]
        if of_class.empty:
            counts = counts_of(boxes["class"])
            fault = f"no box of class {name!r}{did_you_mean(name, counts)}, so its size is unknown"
            raise InputError(fault, found=listed(counts))
        sizes = of_class[list(SIZE)]
        if "object_id" in keys:
            sizes = sizes.groupby([of_class[key] for key in keys], observed=True).mean()
        length, width, height = size = tuple(round(float(side), 3) for side in sizes.mean())
        if min(size) <= 0:
            raise InputError("no size for anchors", place=f"boxes of class {name!r}", found=size)
        bottom = float((of_class["z"] - of_class["height"] / 2).median())
        objects.append(TypicalObject(name, (length, width, height), round(bottom, 3) + 0.0))
    return tuple(objects)


def as_plain(typical: Sequence[TypicalObject]) -> list[dict[str, object]]:
    """Convert typical objects to the plain values of a checkpoint."""
    plain: list[dict[str, object]] = _TYPICAL.dump_python(tuple(typical), mode="json")
    return plain


def from_plain(content: Mapping[str, Any]) -> tuple[TypicalObject, ...]:
    """Read the typical objects of a checkpoint, if any; ValueError unless `as_plain` made them."""
    return validated(tuple[TypicalObject, ...], content.get("typical", ()), "typical")
