"""Names of object classes: which are possible, and which a mistyped name may mean."""

import re
import reprlib
from collections.abc import Iterable, Mapping
from typing import Any

import pandas as pd

from lidarplace.base.errors import InputError
from lidarplace.base.suggestions import did_you_mean

IGNORE = "ignore"
"""Entry of a class map for a category whose boxes are left out."""

ALL = "all"
"""Name of all classes together in tables."""

_NAME = re.compile(r"\w[\w.-]*")
_LONGEST = 64
_SHOWN = 12
CLASS_NAME = f"at most {_LONGEST} letters, digits, _, - and ., other than {ALL} and {IGNORE}"


def is_class_name(name: Any) -> bool:
    """Return whether a class can have that name.

    Names are parts of those of files and columns, and words of a line of KITTI's labels."""
    possible = isinstance(name, str) and len(name) <= _LONGEST and name not in (ALL, IGNORE)
    return possible and _NAME.fullmatch(name) is not None


def check_class_name(name: Any, **parts: str) -> None:
    """Raise InputError of these `parts`, unless a class can have that name."""
    if not is_class_name(name):
        text = reprlib.repr(name) if isinstance(name, str) else str(name)[:_LONGEST]
        raise InputError(expected=CLASS_NAME, found=text, **parts)


def check_among(names: Iterable[str], classes: Iterable[str], **parts: str) -> None:
    """Raise InputError of these `parts` unless all `names` are among `classes`.

    The error suggests a similar class: a name that none has would count for nothing."""
    class_names = list(dict.fromkeys(classes))
    for name in names:
        if name not in class_names:
            problem = f"{name} is not among classes{did_you_mean(name, class_names)}"
            raise InputError(problem, expected=", ".join(class_names) or "none", **parts)


def counts_of(classes: pd.Series) -> dict[str, int]:
    """Count the boxes of each class, most first."""
    return {str(name): int(count) for name, count in classes.value_counts().items() if count}


def listed(counts: Mapping[str, int]) -> str:
    """Format counts, such as "Car (1,204), Truck (36)"."""
    texts = [f"{name} ({count:,})" for name, count in list(counts.items())[:_SHOWN]]
    return ", ".join(texts) + " …" * (len(counts) > _SHOWN) or "none"
