"""Plug-ins that misbehave: refused in one line that names them; right ones are done."""

import pytest

from tests.fuzz.cases import faults
from tests.fuzz.judge import DONE
from tests.fuzz.plugins import RIGHT, outcome_of_plugin, run_plugin


@pytest.mark.parametrize(
    ("kind", "value"), [(k, value) for k, values in RIGHT.items() for value in values]
)
def test_a_right_plugin_is_done(kind, value, world, tmp_path):
    outcome = outcome_of_plugin(kind, "value", value, world, tmp_path / "place")
    assert outcome.kind == DONE, outcome.told


@pytest.mark.parametrize("kind", RIGHT)
def test_wrong_plugins(kind, world, tmp_path):
    assert not faults(run_plugin, [kind], 50, 25, world, tmp_path)


@pytest.mark.long
def test_many_wrong_plugins(world, tmp_path):
    assert not faults(run_plugin, list(RIGHT), 51, 200, world, tmp_path)
