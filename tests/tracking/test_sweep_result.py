"""`sweep.json` is read as what it has to be, or refused in one line."""

import copy
import json
import math
import shutil

import pytest

from lidarplace.base.errors import InputError
from tracking.run_folders.json_file import read_result_file
from tracking.run_folders.sweep import RunFolder
from tracking.run_folders.sweep_json import SweepResult

NEEDED = [name for name, field in SweepResult.model_fields.items() if field.is_required()]
WRONG = [None, True, -1, 0, 3, 1e308, math.nan, "x", "", [], ["x"], [[]], [None], {}, {"x": None}]


@pytest.fixture(scope="module")
def folder(made_up_run, tmp_path_factory):
    return shutil.copytree(made_up_run, tmp_path_factory.mktemp("copies") / "grid")


@pytest.fixture
def sweep(folder):
    """`sweep.json`, as it is again afterwards."""
    text = (folder / "sweep.json").read_text()
    yield json.loads(text)
    (folder / "sweep.json").write_text(text)


def refused(folder, text):
    """The error of one line by which a folder with this `sweep.json` is refused."""
    mode = "wb" if isinstance(text, bytes) else "w"
    with (folder / "sweep.json").open(mode) as file:
        file.write(text)
    with pytest.raises(InputError, match=r"^[^\n]+$") as error:
        RunFolder.read(folder)
    assert error.value.place == str(folder / "sweep.json")
    return error.value


def places(value, at=()):
    """Key paths of everything in nested data."""
    yield at
    if isinstance(value, (dict, list)):
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from places(item, (*at, key))


def test_wrong_types_everywhere(tmp_path, sweep):
    file, lines = tmp_path / "sweep.json", []
    for at in places(sweep):
        if not at or at[0] == "versions" or set(at) & {1, 2, 3, "center", "trapezoid"}:
            continue  # like others
        for value in WRONG:
            changed = copy.deepcopy(sweep)
            place = changed
            for key in at[:-1]:
                place = place[key]
            place[at[-1]] = value
            file.write_text(json.dumps(changed))
            try:
                read_result_file(file, SweepResult).rigs  # noqa: B018 - poses are made of it
            except ValueError as error:
                lines.append(str(error))
    assert len(lines) > 200
    assert all(line.startswith(f"{file}: ") and "\n" not in line for line in lines)


@pytest.mark.parametrize("key", NEEDED)
def test_a_key_that_is_missing_or_null_is_named(folder, sweep, key):
    for changed in ({k: v for k, v in sweep.items() if k != key}, sweep | {key: None}):
        message = refused(folder, json.dumps(changed))
        assert (message.key, "None" in str(message)) == (key, key in changed)


@pytest.mark.parametrize(
    "text", [b"\xff\xfe{}", "", "{", "[]", "3", "null", "[" * 100_000, '{"a":' * 100_000]
)
def test_what_is_no_mapping_of_json(folder, sweep, text):
    refused(folder, text)
