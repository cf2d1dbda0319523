"""Tables that pandas pickled; nothing but data is unpickled, because pickles can run programs."""

import gzip
import io
import zlib
from pathlib import Path
from typing import Any

import pandas as pd
from pandas.compat.pickle_compat import Unpickler  # type: ignore[import-not-found]

from lidarplace.base.errors import InputError
from lidarplace.files.atomic import first_line
from lidarplace.files.regular import regular

MOST_BYTES = 1_000_000_000  # of a table: of 170,000 points they are 8 million
_NAMES = {
    "builtins": "bytearray slice",
    "numpy": "dtype ndarray",
    "numpy._core.multiarray": "_reconstruct",
    "numpy._core.numeric": "_frombuffer",
    "pandas": "DataFrame Index RangeIndex StringDtype",
    "pandas._libs.internals": "_unpickle_block",
    "pandas.arrays": "ArrowStringArray",
    "pandas.core.frame": "DataFrame",
    "pandas.core.indexes.base": "Index _new_Index",
    "pandas.core.indexes.numeric": "Float64Index Int64Index",
    "pandas.core.indexes.range": "RangeIndex",
    "pandas.core.internals.blocks": "new_block",
    "pandas.core.internals.managers": "BlockManager",
    "pyarrow.lib": "_restore_array py_buffer type_for_alias",
}
"""Functions and classes of tables of numbers and texts, by module, of all versions of pandas."""


class _DataUnpickler(Unpickler):  # type: ignore[misc]
    """Unpickler of pandas' tables, also those that older versions wrote."""

    def find_class(self, module: str, name: str) -> Any:
        """Return a function or a class that tables need; raises InputError for others."""
        module = module.replace("numpy.core", "numpy._core")  # as it was called before
        if name not in _NAMES.get(module, "").split():
            raise InputError(expected="a table of pandas", found=f"{module}.{name} in the pickle")
        return super().find_class(module, name)


def read_pickle(path: Path) -> pd.DataFrame:
    """Read a table that pandas pickled and gzip compressed, `.pkl.gz`.

    Raises OSError, and ValueError that names the file for anything else in it."""
    try:
        with regular(path).open("rb") as packed, gzip.open(packed) as file:
            data = file.read(MOST_BYTES + 1)
    except (EOFError, gzip.BadGzipFile, zlib.error) as error:
        raise InputError(f"not compressed by gzip: {error}", place=path) from None
    if len(data) > MOST_BYTES:
        raise InputError("too large", place=path, expected=f"at most {MOST_BYTES:,} bytes")
    try:
        table = _DataUnpickler(io.BytesIO(data)).load()
        if not isinstance(table, pd.DataFrame):
            raise InputError(expected="a table of pandas", found=type(table).__name__)
        return pd.DataFrame({str(name): column.to_numpy() for name, column in table.items()})
    except Exception as error:  # a damaged pickle may raise any
        raise InputError(f"not pickled by pandas: {first_line(error)}", place=path) from None
