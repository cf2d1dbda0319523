"""Verdicts do not depend on where the grid of positions begins: against positions 2 cm apart."""

import numpy as np
import pytest

from lidarplace import Lidar, Mount, Placement
from lidarplace.mounting.vehicle import Vehicle, with_keep_outs
from lidarplace.requirements.area import Area, in_the_way
from lidarplace.requirements.check_requirements import check_requirements
from lidarplace.requirements.layout import lay_out
from lidarplace.requirements.rays_on_objects import count_points, sights_of
from lidarplace.requirements.requirement import PlacedObject, Requirement

CAR = Vehicle.car()
RIG = Placement(
    "rig", [Mount(x=0.5, y=0.3, z=1.9)], Lidar(tuple(np.radians([-40, -25, -12, -3])), 240)
)
PERSON = PlacedObject(0.55, 0.6, 1.7, headings=2)
NEED = 20


class Shifted(Area):
    """An area whose grid begins somewhere else."""

    by = (0.0, 0.0)

    def sides(self, vehicle):
        return tuple(
            (low - off, high)
            for (low, high), off in zip(super().sides(vehicle), self.by, strict=True)
        )


def result(share, by=(0.0, 0.0), step=0.25, need=NEED, vehicle=CAR):
    area = Shifted(x=(1.5, 5.0), y=((0.2, 2.5),), distance=(0.3, 2.0))
    object.__setattr__(area, "by", by)
    wanted = Requirement("near", area, "points", need, PERSON, share, step)
    return check_requirements([lay_out(wanted, vehicle)], RIG, vehicle)[0]


def verdict(outcome):
    return "open" if outcome.worst.undecided else outcome.met


@pytest.fixture(scope="module")
def fine():
    """Points on the person at places 2 cm apart, in the worst heading that fits."""
    x, y = np.meshgrid(np.arange(1.51, 5.0, 0.02), np.arange(0.21, 2.5, 0.02), indexing="ij")
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    points = points[Area(distance=(0.3, 2.0)).holds(points[:, 0], points[:, 1], CAR)]
    least, sights = np.full(len(points), np.inf), sights_of(RIG, CAR)
    for angle in PERSON.angles:
        free = ~in_the_way(CAR, points, PERSON.size, angle)
        counts = count_points(sights, PERSON.boxes(points[free], angle))[:, 0]
        least[free] = np.minimum(least[free], counts)
    return least[np.isfinite(least)]


PHASES = [(0.0, 0.0), *map(tuple, np.random.default_rng(3).uniform(0, 0.25, (4, 2)).tolist())]


def test_phases_and_steps_agree(fine):
    fine_share = float((fine >= NEED).mean())
    assert 0.1 < fine_share < 0.9
    verdicts = {}
    for off in (-0.05, -0.01, 0.0, 0.01, 0.05):
        share = round(fine_share + off, 4)
        outcomes = [result(share, by) for by in PHASES] + [result(share, step=0.4)]
        verdicts[off] = {verdict(outcome) for outcome in outcomes}
        assert verdicts[off] <= {off < 0, "open"} or off == 0.0
        for worst in (outcome.worst for outcome in outcomes if outcome.worst.undecided):
            assert worst.undecided < 0.03
            assert worst.value < NEED
            assert abs(worst.enough - fine_share) < worst.undecided / 2
    assert (verdicts[-0.05], verdicts[0.05]) == ({True}, {False})
    assert len(verdicts[0.0] - {"open"}) <= 1


def test_the_worst_place_alone(fine):
    """A need well below, at and above the least of all places."""
    least = fine.min()
    assert {verdict(result(1.0, by, need=0.5 * least)) for by in PHASES} == {True}
    assert {verdict(result(1.0, by, need=least + 3)) for by in PHASES} == {False}
    assert len({verdict(result(1.0, by, need=least)) for by in PHASES} - {"open"}) <= 1


@pytest.mark.parametrize("share", [0.5, 1.0])
def test_a_keep_out_elsewhere_changes_nothing(share):
    antenna = with_keep_outs(CAR, np.array([[[-3.3, 0.1, 2.6], [-2.6, 0.4, 3.0]]]))
    assert result(share, vehicle=antenna).cases == result(share).cases


@pytest.mark.parametrize("share", [0.5, 1.0])
def test_tiny_areas(share):
    """A single place, and a strip that is thinner than a step."""
    for sides in ({"x": (3.5, 3.5), "y": ((1.0, 1.0),)}, {"x": (3.0, 5.0), "y": ((1.0, 1.1),)}):
        wanted = Requirement("near", Area(**sides), "points", 1.0, PERSON, share, 0.25)
        assert check_requirements([lay_out(wanted, CAR)], RIG, CAR)[0].met
