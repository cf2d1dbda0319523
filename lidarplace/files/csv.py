"""A table as a CSV file that a spreadsheet shows and does not compute."""

from pathlib import Path

import pandas as pd

from lidarplace.files.atomic import replacing

_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def write_csv(table: pd.DataFrame, path: Path) -> None:
    """Write `table` without its index, see `replacing`. Texts, heads included, that a spreadsheet
    would take for formulas have an apostrophe in front, with which spreadsheets mark texts. Numbers
    are as they are."""
    texts = [not pd.api.types.is_numeric_dtype(kind) for kind in table.dtypes]
    shown = table.rename(columns=_as_text)
    for i in (i for i, is_text in enumerate(texts) if is_text):
        shown.isetitem(i, shown.iloc[:, i].astype(object).map(_as_text).to_numpy())
    with replacing(path) as partial:
        shown.to_csv(partial, index=False)


def _as_text(cell: object) -> object:
    return f"'{cell}" if isinstance(cell, str) and cell.startswith(_FORMULA) else cell
