"""Tables that a sweep or a search left: what their columns hold, in whichever table."""

from __future__ import annotations

import reprlib
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from lidarplace.files.columns import check_columns
from lidarplace.files.tables import read_parquet

NUMBERS = frozenset(
    (
        *("value", "ground_truths", "iou", "seconds", "pog_seconds", "q", "expected_ig", "epoch"),
        *("recall", "precision", "from_m", "to_m", "objects", "mean", "median", "p10", "unseen"),
        *("resolution", "azimuth_steps", "frames", "comparable", "sd", "bias", "low", "high"),
        *("resample", "rank", "seed", "bound", "gain", "step", "number", "draws", "worst", "share"),
        *("difference", "difference_low", "difference_high", "seeds", "violation", "boxes"),
    )
)
TEXTS = frozenset(
    (
        *("trial", "placement", "class", "detector", "metric", "difficulty", "surrogate", "method"),
        *("status", "error", "stage", "label", "rig", "case", "objective", "role", "kind", "state"),
    )
)
FLAGS = frozenset(("cached", "reference", "feasible", "possible"))


def read_result_table(
    file: Path, columns: Sequence[str], numbers: Sequence[str] = ()
) -> pd.DataFrame:
    """The table in `file`, which has `columns`; where none is there, because no row was written,
    they are empty. Values may be missing.

    Args:
        numbers: columns that hold numbers in this table alone.

    Raises:
        ValueError: the file is no table, lacks a column, or a column holds something else than
            its name tells.
    """
    table = read_parquet(file)
    if table.shape == (0, 0):
        return table.reindex(columns=list(columns))
    if not table.columns.is_unique:
        twice = table.columns[table.columns.duplicated()][0]
        raise ValueError(f"{file}: column {twice} is there twice")
    check_columns(list(table.columns), columns, str(file))
    for name in columns:
        known = table[name].dropna()
        if not len(known):
            continue
        kind = name.partition(".")[0]  # value.price, violation.distance
        if kind in NUMBERS or kind in numbers:
            good = known.dtype.kind in "iuf"
            wanted = "numbers"
        elif kind in FLAGS:
            good, wanted = known.dtype.kind == "b", "true and false"
        elif kind in TEXTS:
            good = pd.api.types.infer_dtype(known) in ("string", "categorical")
            wanted = "text"
        else:
            continue
        if not good:
            raise ValueError(
                f"{file}: column {name} must hold {wanted}, found {known.dtype}, "
                f"such as {reprlib.repr(known.iloc[0])}"
            )
    return table
