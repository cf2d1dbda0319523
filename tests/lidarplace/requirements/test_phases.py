"""Verdicts do not depend on where the first positions are: against positions 1 cm apart."""

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
    """Points on the person at places 1 cm apart, in the worst heading that fits."""
    x, y = np.meshgrid(np.arange(1.505, 5.0, 0.01), np.arange(0.205, 2.5, 0.01), indexing="ij")
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    points = points[Area(distance=(0.3, 2.0)).holds(points[:, 0], points[:, 1], CAR)]
    least, sights = np.full(len(points), np.inf), sights_of(RIG, CAR)
    for angle in PERSON.angles:
        free = ~in_the_way(CAR, points, PERSON.size, angle)
        counts = count_points(sights, PERSON.boxes(points[free], angle))[:, 0]
        least[free] = np.minimum(least[free], counts)
    return least[np.isfinite(least)]


def test_phases_and_steps_agree(fine):
    fine_share = float((fine >= NEED).mean())
    assert 0.1 < fine_share < 0.9
    random = np.random.default_rng(3)
    phases = [tuple(off) for off in random.uniform(0, 0.25, (8, 2))]
    verdicts = {}
    for share in np.round(fine_share + np.array([-0.05, -0.01, 0.0, 0.01, 0.05]), 4).tolist():
        outcomes = [result(share, by) for by in phases] + [result(share, step=0.2 + 0.1 / 3)]
        verdicts[share] = {verdict(outcome) for outcome in outcomes}
        assert verdicts[share] <= {share < fine_share, "open"}, share
        for outcome in outcomes:
            assert outcome.worst.undecided < 0.1
            if outcome.worst.undecided:
                assert outcome.worst.value < NEED
                assert outcome.worst.enough <= fine_share + 0.002
                assert outcome.worst.enough + outcome.worst.undecided >= fine_share - 0.002
    first, *_, last = verdicts.values()
    assert (first, last) == ({True}, {False})


def test_the_worst_place_alone(fine):
    """A need well below, at and above the least of all places."""
    least = fine.min()
    phases = [(0.0, 0.0), (0.07, 0.19), (0.21, 0.02)]
    assert {verdict(result(1.0, by, need=0.5 * least)) for by in phases} == {True}
    assert {verdict(result(1.0, by, need=least + 3)) for by in phases} == {False}
    assert len({verdict(result(1.0, by, need=least)) for by in phases} - {"open"}) <= 1


def test_a_keep_out_elsewhere_changes_nothing():
    antenna = with_keep_outs(CAR, np.array([[[-3.3, 0.1, 2.6], [-2.6, 0.4, 3.0]]]))
    for share in (0.8, 0.9, 1.0):
        assert result(share, vehicle=antenna).cases == result(share).cases
