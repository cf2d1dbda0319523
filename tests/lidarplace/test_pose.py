import json
from pathlib import Path

import numpy as np
import pytest

from lidarplace.rigs.pose import from_carla, rotation

CARLA = json.loads((Path(__file__).parents[1] / "data/carla_transforms.json").read_text())["poses"]


def test_senses_of_rotation():
    x, y = np.eye(3)[:2]
    assert (rotation(0, 0.1, 0) @ x)[2] < 0, "pitch > 0 tips the nose down"
    assert (rotation(0.1, 0, 0) @ y)[2] > 0, "roll > 0 lifts the left side"
    assert (rotation(0, 0, 0.1) @ x)[1] > 0, "yaw > 0 turns to the left"


@pytest.mark.parametrize("pose", CARLA)
def test_conversion_agrees_with_carla(pose):
    x, y, z, roll, pitch, yaw = from_carla(
        *(pose[name] for name in ("x", "y", "z", "roll", "pitch", "yaw"))
    )
    mirror = np.diag([1.0, -1.0, 1.0])
    theirs = np.array(pose["matrix"])
    # CARLA computes in float32.
    np.testing.assert_allclose(
        rotation(roll, pitch, yaw), mirror @ theirs[:3, :3] @ mirror, atol=1e-6
    )
    np.testing.assert_allclose([x, y, z], mirror @ theirs[:3, 3], atol=1e-6)


def test_conversion_is_its_own_inverse():
    pose = (1.0, -2.0, 3.0, 0.1, -0.2, 0.3)
    assert from_carla(*from_carla(*pose)) == pose
