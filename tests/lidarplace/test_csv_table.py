"""CSV files: texts that a spreadsheet would compute are texts, numbers are numbers."""

import csv

import numpy as np
import pandas as pd
import pytest

from lidarplace.files.tables import write_csv


def rows(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.reader(file))


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1", "@x", "\tx", '=cmd|" /C calc"!A0', "-a, b"])
@pytest.mark.parametrize("dtype", [object, "string", "category"])
def test_a_text_that_looks_like_a_formula(tmp_path, text, dtype):
    names = pd.Series([text, "line"], dtype=dtype)
    table = pd.DataFrame({"placement": names, text: [-1.5, np.nan]})
    before = table.copy()
    write_csv(table, tmp_path / "t.csv")
    expected = [["placement", f"'{text}"], [f"'{text}", "-1.5"], ["line", ""]]
    assert rows(tmp_path / "t.csv") == expected
    pd.testing.assert_frame_equal(table, before)


def test_all_else_is_as_pandas_writes_it(tmp_path):
    table = pd.DataFrame(
        {
            "name": ["a,b", 'c"d', None, "e=f"],
            "mixed": [-1, "x", np.nan, 2.5],
            "number": [-1e-300, np.inf, np.nan, 0.1],
            "count": [-1, 2, 3, 4],
            "flag": [True, False, True, False],
        }
    )
    write_csv(table, tmp_path / "t.csv")
    assert (tmp_path / "t.csv").read_text() == table.to_csv(index=False)


def test_two_columns_of_one_name(tmp_path):
    write_csv(pd.DataFrame([["=a", "=b"]], columns=["x", "x"]), tmp_path / "t.csv")
    assert rows(tmp_path / "t.csv") == [["x", "x"], ["'=a", "'=b"]]
