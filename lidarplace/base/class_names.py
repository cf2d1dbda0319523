"""Names of object classes: which are possible, and what a log has where one is mistyped."""

import re
import reprlib
from collections.abc import Mapping
from typing import Any

import pandas as pd

IGNORE = "ignore"
"""What a class map says of a category whose boxes are left out."""

ALL = "all"
"""What tables call all classes together."""

_NAME = re.compile(r"\w[\w.-]*")
_LONGEST = 64
_SHOWN = 12


def fault_of_name(name: Any) -> str | None:
    """What is wrong with the name of a class; None if nothing is.
    Names are parts of those of files and columns, and words of a line of KITTI's labels."""
    if isinstance(name, str) and name in (ALL, IGNORE):
        return f"{name!r} is no name of a class: it has a meaning of its own"
    if not isinstance(name, str) or len(name) > _LONGEST or not _NAME.fullmatch(name):
        shown = reprlib.repr(name) if isinstance(name, str) else str(name)[:_LONGEST]
        return (
            f"a class has a name of letters, digits, _, - and ., at most {_LONGEST}, found {shown}"
        )
    return None


def counts_of(classes: pd.Series) -> dict[str, int]:
    """How many boxes there are of each class, most first."""
    return {str(name): int(count) for name, count in classes.value_counts().items() if count}


def listed(counts: Mapping[str, int]) -> str:
    """ "Car (1,204), Truck (36)" """
    shown = [f"{name} ({count:,})" for name, count in list(counts.items())[:_SHOWN]]
    return ", ".join(shown) + " …" * (len(counts) > _SHOWN) or "none"
