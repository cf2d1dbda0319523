"""Command lines with one wrong value: refused in one line, or done."""

import pytest

from tests.fuzz.cases import copied, faults
from tests.fuzz.judge import DONE
from tests.fuzz.lines import LINES, outcome_of_line, run_line
from tests.fuzz.targets import parts_of


@pytest.mark.parametrize("name", LINES)
def test_a_right_line_is_taken(name, world, tmp_path):
    line, place = LINES[name], tmp_path / "world"
    copied(world, place, parts_of(f"{line.line} {line.needs}", world))
    outcome = outcome_of_line(line, line.arguments, (), place)
    assert outcome.kind == DONE, outcome.told


@pytest.mark.parametrize("name", LINES)
def test_lines(name, world, tmp_path):
    assert not faults(run_line, [name], 0, 4, world, tmp_path)


@pytest.mark.long
def test_many_lines(world, tmp_path):
    assert not faults(run_line, list(LINES), 1, 100, world, tmp_path)
