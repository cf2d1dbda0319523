import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("carla")

from carla_world import cast

from lidarplace.plugins.carla.lidars import mount_transform
from lidarplace.plugins.carla.returns import ego_points
from lidarplace.rig_files.carla import attributes, even_fans
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import PAPER_PLACEMENTS, Mount

PAPER = Lidar.paper()


class Sensor:
    def __init__(self, lidar, fan, pose):
        unset = {"atmosphere_attenuation_rate": "0.004"}
        self.attributes = unset | attributes(lidar, fan, seed=0)
        self.matrix = np.array(pose.get_matrix())


def all_points(returns, mount, lidar):
    everywhere = (-np.inf,) * 3 + (np.inf,) * 3
    return ego_points(returns, mount, lidar, everywhere, (-1.0, -1.0, -1.0))


def test_the_papers_beam_table_is_one_sensor():
    (fan,) = even_fans(PAPER.elevations)
    values = {name: float(value) for name, value in attributes(PAPER, fan, seed=5).items()}
    assert values["channels"] == 16
    assert values["points_per_second"] == 90_000 * 20
    assert (values["lower_fov"], values["upper_fov"]) == pytest.approx((-25, 5), abs=1e-6)
    assert values["rotation_frequency"] == 20
    assert values["dropoff_general_rate"] == values["dropoff_zero_intensity"] == 0


def test_whole_numbers_are_written_whole():
    values = attributes(PAPER, even_fans(PAPER.elevations)[0], seed=2**31 + 5)
    found = [values[name] for name in ("channels", "points_per_second", "noise_seed")]
    assert found == ["16", "1800000", "5"]
    assert attributes(PAPER, even_fans([0.0])[0], seed=2**31 - 1)["noise_seed"] == "2147483647"


def test_an_uneven_table_is_several_sensors():
    table = np.radians([-25, -19, -15, -13, -11, -9, -7, -5.5, -4, -2.5, 10])
    fans = even_fans(table[::-1])  # in any order
    beams = np.concatenate([np.linspace(fan.lower, fan.upper, fan.beams) for fan in fans])
    np.testing.assert_allclose(beams, table, atol=1e-6)
    assert len(fans) < 6


@settings(derandomize=True)
@given(st.lists(st.floats(-math.pi / 2, math.pi / 2), min_size=1, max_size=40))
def test_fans_hold_every_beam_once(elevations):
    fans = even_fans(elevations)
    beams = np.concatenate([np.linspace(fan.lower, fan.upper, fan.beams) for fan in fans])
    np.testing.assert_allclose(np.sort(beams), np.sort(elevations), atol=1e-6)
    assert len(fans) <= (len(elevations) + 1) // 2


@pytest.mark.parametrize("mount", PAPER_PLACEMENTS["pyramid_roll"].mounts)
def test_mount_in_carlas_own_matrix(mount):
    pose = np.array(mount_transform(mount, (0.0, 0.0)).get_matrix())
    mirror = np.diag([1, -1, 1])
    np.testing.assert_allclose(mirror @ pose[:3, :3] @ mirror, mount.rotation, atol=1e-6)
    np.testing.assert_allclose(mirror @ pose[:3, 3], mount.position, atol=1e-6)


def test_returns_of_a_tilted_lidar_lie_on_a_plane_in_the_ego_frame():
    # The world's plane rises along x by 4 degrees, and the ego stands level at its foot.
    mount = Mount(0.2, 0.6, 2.2, roll=-0.28, pitch=0.1, yaw=1.0)
    lidar = Lidar((-0.4, -0.1), azimuth_steps=90)
    (fan,) = even_fans(lidar.elevations)
    points = all_points(cast(Sensor(lidar, fan, mount_transform(mount, (0, 0))), []), mount, lidar)
    assert len(points) > 60
    rise = math.tan(math.radians(4))
    np.testing.assert_allclose(points[:, 2], rise * points[:, 0], atol=2e-4)


def test_field_of_view_is_cut_from_the_full_turn():
    lidar = Lidar((-0.3,), azimuth_steps=360, azimuth=(math.radians(80), math.radians(200)))
    mount = Mount(z=2.0)
    (fan,) = even_fans(lidar.elevations)
    points = all_points(cast(Sensor(lidar, fan, mount_transform(mount, (0, 0))), []), mount, lidar)
    turned = np.degrees(np.arctan2(points[:, 1], points[:, 0])) % 360
    assert turned.min() >= 80 - 1e-3
    assert turned.max() <= 200 + 1e-3
    assert abs(len(points) - lidar.fired_steps) <= 2  # rounding in float32 at the two ends


def test_crop_and_own_body():
    points = np.array(
        [[0, 0, 1.0, 1], [2.3, 0, 0.5, 1], [2.6, 0, 0.5, 1], [10, 3, 0, 1], [10.1, 0, 0, 1]],
        np.float32,
    )
    lidar = Lidar((0.0,), azimuth_steps=8)
    kept = ego_points(points, Mount(), lidar, (-10, -10, -1, 10, 10, 3), (4.6, 2.0, 1.5))
    np.testing.assert_array_equal(kept, points[[2, 3]] * [1, -1, 1, 1])  # y to the left
