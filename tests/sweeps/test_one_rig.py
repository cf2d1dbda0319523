"""A configuration's rigs are built once, and its way to the first task is short."""

from collections import Counter
from pathlib import Path

import pytest

from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Placement
from sweeps.plan.plan import read_plan

GRID = Path(__file__).parents[2] / "examples/grid.yaml"


@pytest.fixture
def built(monkeypatch):
    """What is built, and how often."""
    found = Counter()

    def counting(kind):
        check = kind.__post_init__

        def counted(self):
            check(self)
            found[self] += 1

        monkeypatch.setattr(kind, "__post_init__", counted)

    counting(Placement)
    counting(Lidar)
    return found


@pytest.mark.parametrize("fog", [[], ["weather={visibility: 200}"]])
def test_planning_builds_a_rig_once_and_a_lidar_once_a_model(built, fog):
    sweep, plan = read_plan(GRID, fog)
    assert len(plan.trials) == 4
    assert max(built.values()) == 1
    rigs = {point.rig.mounts for point in sweep.points}
    own = [rig for rig in built if isinstance(rig, Placement) and rig.mounts in rigs]
    assert len(own) == 8  # as it is, and with the azimuth steps of its clouds
    # In clear air and in the weather, and with the azimuth steps of its clouds.
    assert sum(isinstance(lidar, Lidar) for lidar in built) == 2 + len(fog)


def test_rungs_and_seeds_share_a_rig(built):
    more = ["grid.seed=[1, 2]", "promote=[{by: recall, keep: 2, set: {training.epochs: 1}}]"]
    sweep, _ = read_plan(GRID, [*more, "grid.placement=[corners, line]"])
    assert len({id(point.rig) for point in sweep.points}) == 2 < len(sweep.points) == 8
    assert max(built.values()) == 1
