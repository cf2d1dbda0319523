"""Whether a table that was written has the columns that its model tells."""

import re

import pandas as pd

from tracking.run_folders.table_schema import TableSchema


def check_columns(frame: pd.DataFrame, table: TableSchema) -> None:
    """Those of the model in its order and of its types; axes of the grid may stand among them."""
    fixed = [column for column in table.columns if not re.search("[A-Z]", column.name)]
    names = [column.name for column in fixed]
    assert [name for name in frame.columns if name in names] == names, table.file
    for column in fixed:
        if column.dtype is not None:
            assert frame[column.name].dtype == column.dtype, (table.file, column.name)
