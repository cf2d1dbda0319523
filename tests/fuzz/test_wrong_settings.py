"""Wrong settings: refused in one line that names the place, or done."""

import pytest

from tests.fuzz.cases import faults, run_case
from tests.fuzz.targets import SETTINGS
from tests.fuzz.test_data import names


@pytest.mark.parametrize("target", SETTINGS, ids=names(SETTINGS))
def test_settings(target, world, tmp_path):
    assert not faults(run_case, [target], 0, 5, world, tmp_path)


@pytest.mark.long
def test_many_settings(world, tmp_path):
    assert not faults(run_case, SETTINGS, 1, 100, world, tmp_path)
