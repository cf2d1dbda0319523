"""Recall over the ground around a vehicle, against requirements at the same places."""

from dataclasses import replace

import numpy as np
import pytest

from lidarplace import Lidar, Mount, Placement
from lidarplace.clouds.own_body import sedan
from lidarplace.recall.detection_curve import default_curves
from lidarplace.requirements import recall_ground as module
from lidarplace.requirements.area import Area
from lidarplace.requirements.check_requirements import check_requirements
from lidarplace.requirements.layout import lay_out
from lidarplace.requirements.recall_ground import recall_ground
from lidarplace.requirements.requirement import STANDARD, Requirement

LIDAR = Lidar(np.radians(np.linspace(-20, 5, 8)), 120)
FRONT, REAR = Mount(x=2.6, z=0.6), Mount(x=-2.6, z=0.6, yaw=np.pi)


@pytest.fixture(autouse=True)
def near(monkeypatch):
    monkeypatch.setattr(module, "REACH_M", 6.0)


def chance_at(rig, x, y):
    """The mean chance of a pedestrian at x, y that faces ahead and to the left."""
    curve, chances = default_curves().of("Pedestrian", 0.5), []
    area, upright = Area(x=(x, x), y=((y, y),)), replace(STANDARD["Pedestrian"], headings=1)
    for placed in (upright, replace(upright, length=upright.width, width=upright.length)):
        asked = Requirement("there", area, "probability", 0.0, placed, step=1.0, curve=curve)
        (result,) = check_requirements([lay_out(asked, sedan())], rig, sedan())
        chances.append(result.least_of[0])
    return np.mean(chances)


def test_a_cell_has_what_a_requirement_counts_there():
    ground = recall_ground(Placement("one", [FRONT], lidar=LIDAR), sedan(), "Pedestrian")
    assert ground.dead is None
    np.testing.assert_array_equal(ground.degraded, ground.built)
    assert ground.built.shape == (len(ground.x), len(ground.y))
    rig = Placement("one", [FRONT], lidar=LIDAR)
    for i, j in ((-1, len(ground.y) // 2), (-2, 1), (0, 0)):
        assert ground.built[i, j] == pytest.approx(chance_at(rig, ground.x[i], ground.y[j]))
    assert np.nanmax(ground.built) > 0.3


def test_the_dead_lidar_is_the_one_that_costs_most():
    weak = Lidar(np.radians([2.0, 4.0]), 20)
    rig = Placement("two", [FRONT, REAR], lidar=[weak, LIDAR])
    ground = recall_ground(rig, sedan(), "Pedestrian")
    assert ground.dead == 1
    assert np.nanmean(ground.degraded) < np.nanmean(ground.built)
    alone = Placement("alone", [FRONT], lidar=weak, dead=[(REAR, LIDAR)])
    np.testing.assert_allclose(
        ground.degraded, recall_ground(alone, sedan(), "Pedestrian").built, atol=1e-12
    )
