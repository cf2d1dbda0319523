"""Which column of a label file is what, by its name; the class of a category."""

import re
from collections.abc import Mapping, Sequence
from difflib import SequenceMatcher
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from lidarplace.configuration.yaml import read_yaml_file
from lidarplace.scenes.label_tables.units import plain, without_unit

ALIKE = 0.8
"""Names less alike than this share of their letters are not taken for each other."""

_NAMES = read_yaml_file(Path(__file__).with_name("names.yaml"))
USUAL: Mapping[str, str] = _NAMES["usual"]
"""Key of the mapping -> names that it has in label files."""
_STEM = re.compile("|".join(f"(?P<{word}>{stems})" for word, stems in _NAMES["stems"].items()))
"""Of German and French words, in groups called by the English one."""


def class_in(category: str) -> str | None:
    """The class that the name of a category implies."""
    found = (c for c, told in _NAMES["classes"].items() if re.search(told, category, re.IGNORECASE))
    return next(found, None)


def _in_english(name: str) -> str:
    """A plain name with the words for which there are stems: `objektklasse` is `object_class`."""
    words = [[str(m.lastgroup) for m in _STEM.finditer(word)] or [word] for word in name.split("_")]
    return "_".join(part for parts in words for part in parts)


def guess_columns(columns: Sequence[str]) -> dict[str, str]:
    """A column for each key of `USUAL` that has one, so that names are most alike altogether."""
    likeness = np.array([[_likeness(name, usual) for name in columns] for usual in USUAL.values()])
    likeness = np.where(likeness < ALIKE, 0.0, likeness)
    keys = list(USUAL)
    pairs = zip(*linear_sum_assignment(-likeness), strict=True)
    return {keys[i]: columns[j] for i, j in pairs if likeness[i, j] > 0}


def _likeness(name: str, usual: str) -> float:
    """1 for a usual name, a little less for a later one."""
    own = {plain(name), without_unit(name), _in_english(without_unit(name))}
    own |= {re.sub("^(object|obj|box)_|_(object|obj|box)$", "", mine) for mine in own}
    return max(
        SequenceMatcher(None, mine, other).ratio() - 0.001 * place
        for mine in own
        for place, other in enumerate(usual.split())
    )
