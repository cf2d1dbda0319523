"""The error of a user's mistake."""

import pickle
from pathlib import Path

import pytest

from lidarplace.base.errors import InputError, at


def test_its_line_has_the_parts_that_are_known():
    parts = {"place": "a.csv: row 3", "key": "x", "expected": "a number", "found": "far"}
    error = InputError("invalid value", **parts, fix="mend it")
    line = "a.csv: row 3: x: invalid value; expected a number, found far; mend it"
    assert str(error) == line
    assert str(InputError("no such file", found="b")) == "no such file; found b"
    sent = pickle.loads(pickle.dumps(error))  # as Ray does
    assert (str(sent), sent.key, sent.found, sent.fix) == (line, "x", "far", "mend it")


def test_unknown_parts_are_empty():
    error = InputError(place=Path("a.csv"), expected="a number", found=None)
    assert str(error) == "a.csv: expected a number, found None"
    assert (error.problem, error.key, error.fix) == ("", "", "")


def test_a_place_comes_in_front_and_parts_stay():
    with pytest.raises(InputError) as error, at("grid.yaml"), at("row 3"):
        raise InputError("far", key="x", expected=1, found=2, fix="mend it")
    assert str(error.value) == "grid.yaml: row 3: x: far; expected 1, found 2; mend it"
    assert (error.value.place, error.value.key) == ("grid.yaml: row 3", "x")
    with pytest.raises(InputError) as error, at(Path("a.csv")):
        float("far")
    assert str(error.value) == "a.csv: could not convert string to float: 'far'"


@pytest.mark.parametrize(
    ("inner", "place", "key", "line"),
    [
        ({"key": "z", "found": 1}, "a.yaml", "roof: z", "a.yaml: roof: z: low; found 1"),
        ({"place": "b.csv", "key": "z"}, "a.yaml", "roof", "a.yaml: roof: b.csv: z: low"),
        ({}, "a.yaml", "roof", "a.yaml: roof: low"),
    ],
)
def test_a_key_comes_in_front_and_a_place_is_not_repeated(inner, place, key, line):
    with pytest.raises(InputError) as error, at("a.yaml"), at("a.yaml"), at(key="roof"):
        raise InputError("low", **inner)
    assert (error.value.place, error.value.key, str(error.value)) == (place, key, line)
