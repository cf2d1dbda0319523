"""The picture of a requirement: its numbers, and the worst place of many."""

import numpy as np

from lidarplace import PAPER_PLACEMENTS
from lidarplace.mounting.outline import outline
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.requirements.area import Area, Positions
from lidarplace.requirements.ground import Ground
from lidarplace.requirements.judge import Finding, Outcome
from lidarplace.requirements.requirement import Requirement
from lidarplace.requirements.tables import case_table, worst_cases
from tracking.pages.requirements import requirement_map


def drawn(numbers, held, needed):
    """The heat map of numbers on a grid of a metre."""
    positions = Positions(np.arange(len(held)) * 1.0, np.arange(held.shape[1]) * 1.0, held)
    wanted = Requirement("<who>", Area(), "points", needed)
    worst = Finding("as built", 0.0, 0.5, 3.0, 0.0, 0.0, 0.0)
    found = Outcome("a<b", wanted, (worst,), positions, numbers[held])
    (row,) = worst_cases(case_table([found]), []).to_dict("records")
    mounts = PAPER_PLACEMENTS["line"].mounts
    plot = requirement_map(row, Ground.of(found), "a<b", mounts, outline(Vehicle.car()))
    assert plot.layout.title.text == "a&lt;b · &lt;who&gt;: FAILED"
    return plot.data[0]


def test_colours_are_in_terms_of_the_need():
    numbers = np.array([[0.0, 5.0], [10.0, 90.0]])
    shown = drawn(numbers, np.array([[True, True], [True, True]]), 10.0)
    assert shown.z.tolist() == [[0.0, 1.0], [0.5, 2.0]], "rows run along y"
    assert np.array_equal(shown.customdata, numbers.T)


def test_of_many_positions_the_worst_is_seen():
    numbers = np.full((500, 3), 20.0)
    numbers[333, 1] = 1.0
    held = np.ones((500, 3), bool)
    held[:, 2] = False
    shown = drawn(numbers, held, 10.0)
    assert shown.z.shape[1] <= 160
    assert np.nanmin(shown.customdata) == 1.0
    assert (shown.customdata[1] == 1.0).sum() == 1
    assert np.isnan(shown.customdata[2]).all()
    x = shown.x[int(shown.customdata[1].argmin())]
    assert abs(x - 333) < 4
