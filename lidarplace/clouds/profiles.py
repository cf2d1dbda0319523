"""Two ways to collect clouds: the one in the paper's text, and that of its published code.

They differ in three ways, each of which can be had alone, to measure its effect on AP: the LiDAR
fires 4,000 rays a frame (5,000 points a second and beam at 20 Hz), not 90,000; roll and pitch in
radians are passed to CARLA, which takes degrees; and clouds of LiDARs at different heights are
merged at different heights, as each LiDAR's own height is taken off in the vehicle's frame."""

from dataclasses import dataclass, replace
from math import radians

from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Placement


@dataclass(frozen=True)
class Profile:
    """Settings of a collection.

    Attributes:
        lidar: sensor of every mount.
        tilt_in_degrees: whether numbers of roll and pitch are taken for degrees.
        misaligned_heights: see `lidarplace.clouds.collect.collect`."""

    lidar: Lidar
    tilt_in_degrees: bool = False
    misaligned_heights: bool = False

    def placement(self, placement: Placement) -> Placement:
        """Return `placement` as this profile tilts it."""
        return with_tilt_in_degrees(placement) if self.tilt_in_degrees else placement


def with_tilt_in_degrees(placement: Placement) -> Placement:
    """Return a placement whose numbers of roll and pitch are taken for degrees."""
    mounts = [replace(m, roll=radians(m.roll), pitch=radians(m.pitch)) for m in placement.mounts]
    return replace(placement, mounts=mounts)


PROFILES: dict[str, Profile] = {
    "paper": Profile(Lidar.paper()),
    "released-code": Profile(
        replace(Lidar.paper(), azimuth_steps=250), tilt_in_degrees=True, misaligned_heights=True
    ),
}
"""The paper's text and its published code. Both know neither range noise nor drop-off; what CARLA
itself adds by default is the LiDAR's to say."""
