"""A rig in the scene of a page: its LiDARs and their points."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lidarplace.rigs.lidar import Lidar, unit_vectors
from lidarplace.rigs.placement import Mount
from lidarplace.studio.frame_view import SimulatedCloud
from lidarplace.studio.rig import Rig

if TYPE_CHECKING:
    import viser

SIZE_M = (0.1, 0.1, 0.07)
"""Size of a LiDAR whose size is not known, metres."""
VIEW_M = 0.6
"""Length of the lines of a field of view, metres."""
DEAD = "#bbbbbb"


class RigNodes:
    """Draws one rig, with colours of its LiDARs in turn, below a node of the scene."""

    def __init__(self, server: viser.ViserServer, colours: Sequence[str], node: str = "") -> None:
        self._scene, self._colours, self._node = server.scene, colours, node
        self._lidars: list[viser.SceneNodeHandle] = []
        unseen = np.zeros((1, 3))  # a cloud without points cannot be drawn
        self._cloud = self._scene.add_point_cloud(
            f"{node}/cloud", unseen, unseen, point_size=0.03, point_shading="flat", visible=False
        )

    def lidars(
        self, rig: Rig, models: tuple[Lidar, ...], chosen: int | None, wrong: Collection[int] | None
    ) -> None:
        """Draw all LiDARs in their size, with what they have in view.

        Lines of the chosen one are thicker; those in `wrong`, which violate a limit, have a cross
        at their number. None: they have no numbers."""
        for node in self._lidars:
            node.remove()
        self._lidars = []
        for number, (mount, lidar) in enumerate(zip(rig.mounts, models, strict=True)):
            works = rig.lidars[number].enabled
            colour = rgb(self._colours[number % len(self._colours)] if works else DEAD)
            name = f"{self._node}/lidars/{number}"
            pose: dict[str, Any] = {"wxyz": quaternion(mount), "position": mount.position}
            self._lidars.append(self._scene.add_frame(name, show_axes=False, **pose))
            self._scene.add_box(f"{name}/body", colour, lidar.size or SIZE_M, cast_shadow=False)
            self._scene.add_line_segments(
                f"{name}/view", _view(lidar), colour, thickness_units="screen",
                thickness=2.5 if number == chosen else 1.0,
            )  # fmt: skip
            if wrong is not None:
                label = f"{number + 1}{' ✗' if number in wrong else ''}{'' if works else ' (dead)'}"
                self._scene.add_label(f"{name}/name", label, position=(0, 0, 0.4))

    def move(self, number: int, mount: Mount) -> None:
        """Put a LiDAR elsewhere, nothing else having changed."""
        if number < len(self._lidars):
            self._lidars[number].position = mount.position
            self._lidars[number].wxyz = quaternion(mount)

    def cloud(self, cloud: SimulatedCloud | None, working: list[int]) -> None:
        """Draw points in the colours of their LiDARs; `working` are those of the cloud."""
        self._cloud.visible = cloud is not None and len(cloud.points) > 0
        if cloud is None or not self._cloud.visible:
            return
        table = np.array([rgb(colour) for colour in self._colours], np.uint8)
        self._cloud.points = cloud.points.astype(np.float16)
        self._cloud.colors = table[np.array(working, np.int64)[cloud.lidar] % len(table)]


def quaternion(mount: Mount) -> NDArray[np.float64]:
    """Return the sensor-to-ego rotation, w first, shape (4,)."""
    return np.asarray(Rotation.from_matrix(mount.rotation).as_quat(scalar_first=True))


def rgb(colour: str) -> tuple[int, int, int]:
    """Return red, green and blue of `#rrggbb`."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:], 16)


def _view(lidar: Lidar) -> NDArray[np.float32]:
    """Return lines of the lowest and the highest beam in the sensor's frame, and their starts."""
    low, high = lidar.azimuth
    turns = np.linspace(low, high, 25)
    ends = np.array([min(lidar.elevations), max(lidar.elevations)])
    rings = VIEW_M * unit_vectors(ends, turns).reshape(2, len(turns), 3)
    lines = [line for ring in rings for line in pairwise(ring)]
    if not lidar.full_turn:
        lines += [(np.zeros(3), ring[end]) for ring in rings for end in (0, -1)]
    lines.append((np.zeros(3), np.array([VIEW_M, 0.0, 0.0])))
    return np.array(lines, np.float32)
