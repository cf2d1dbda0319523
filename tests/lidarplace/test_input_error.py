"""The error of a user's mistake."""

import pickle

from lidarplace.base.errors import InputError


def test_its_line_has_the_parts_that_are_known():
    parts = {"place": "a.csv: row 3", "key": "x", "expected": "a number", "found": "far"}
    error = InputError("invalid value", **parts, fix="mend it")
    line = "a.csv: row 3: x: invalid value; expected a number, found far; mend it"
    assert str(error) == line
    assert str(InputError("no such file", found="b")) == "no such file; found b"
    sent = pickle.loads(pickle.dumps(error))  # as Ray does
    assert (str(sent), sent.key, sent.found, sent.fix) == (line, "x", "far", "mend it")
