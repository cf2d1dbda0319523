"""Error of surrogates against run time, where there is little to compare."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from tests.tracking.made_up_run import NAMES
from tracking.findings.surrogate_accuracy import relative_errors, summarise
from tracking.pages.section import Section
from tracking.report.analysis import Analysis
from tracking.report.sections.accuracy import LEAST_SECONDS, accuracy_section


def section_of(run, table) -> Section:
    return accuracy_section(Analysis(replace(run, accuracy=table)))


@pytest.mark.parametrize("count", [1, 2])
def test_fewer_than_three_placements_have_no_ranking(run, count):
    few = run.accuracy[run.accuracy["placement"].isin(NAMES[:count])]
    few = few.assign(seconds=few["seconds"].mask(few["reference"], 2.0))
    note = section_of(run, few).notes[0]
    assert note.startswith("Car: 0.5 m, cone: 0.01 s a placement, error 0 % against 0.25 m")
    assert note.endswith("faster ones; too few different values of S-MIG for a ranking.")


def test_equal_values_have_no_ranking(run):
    equal = run.accuracy.assign(comparable=-5.0, value=-5.0)
    assert "for a ranking" in section_of(run, equal).notes[0]
    assert "for a ranking" not in section_of(run, run.accuracy).notes[0]


def test_a_time_of_zero_has_a_place_on_a_logarithmic_axis(run):
    fast = run.accuracy.assign(seconds=run.accuracy["seconds"].where(run.accuracy["reference"], 0))
    (figure,) = section_of(run, fast).figures
    x = np.concatenate([trace.x for trace in figure.data])
    assert x.min() == LEAST_SECONDS
    assert len(x) == len(summarise(relative_errors(fast)))


def test_a_surrogate_that_is_zero_has_no_relative_error_and_no_figure(run):
    nothing = run.accuracy.assign(comparable=0.0, value=0.0)
    section = section_of(run, nothing)
    assert section.figures == []
    assert len(section.tables) == 1
    both = [run.accuracy, nothing.assign(surrogate="m_sog")]
    (figure,) = section_of(run, pd.concat(both)).figures
    assert [b.label for b in figure.layout.updatemenus[0].buttons] == ["S-MIG"]
