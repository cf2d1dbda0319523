"""The rigs that recorded data sets: mounts of their calibrations, models that they are known by."""

from collections.abc import Sequence
from dataclasses import replace

from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement
from lidarplace.rigs.pose import angles
from lidarplace.rigs.recorded import RecordedRig
from lidarplace.scenes.datasets.se3 import Poses

NUSCENES_STEPS = 1084
"""Of its HDL-32E, which turns at 20 Hz; the data sheet's steps are those of 10 Hz."""
KITTI_STEPS = 2007
"""Of its HDL-64E, counted in raw sweeps: 2,005 to 2,008."""


def nuscenes_lidar() -> Lidar:
    """The model of LIDAR_TOP."""
    return replace(Lidar.named("hdl32e"), azimuth_steps=NUSCENES_STEPS)


def kitti_lidar() -> Lidar:
    """The model of KITTI's LiDAR."""
    return replace(Lidar.named("hdl64e"), azimuth_steps=KITTI_STEPS)


def argoverse_lidar() -> Lidar:
    """The model of both of Argoverse 2's, which turn at 10 Hz, as in the data sheet."""
    return Lidar.named("vlp32c")


def recorded_rig(
    name: str, names: Sequence[str], sensors: Poses, lidars: Sequence[Lidar]
) -> RecordedRig:
    """A rig of sensors posed in our ego frame, `names`, `sensors` and `lidars` in one order."""
    matrices = sensors.rotation.as_matrix().reshape(-1, 3, 3)
    mounts = [
        Mount(x, y, z, *angles(matrix))
        for (x, y, z), matrix in zip(sensors.position.tolist(), matrices, strict=True)
    ]
    return RecordedRig(tuple(names), Placement(name, mounts, lidars))
