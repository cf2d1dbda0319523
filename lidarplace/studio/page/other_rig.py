"""Another rig of the file next to the selected one: over it, or apart from it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from lidarplace.base.roi import Roi
from lidarplace.rigs.placement import Placement
from lidarplace.studio.frame_view import MOVING_POINTS, RESTING_POINTS, FrameView
from lidarplace.studio.page.panel import NO_RIG, Panel
from lidarplace.studio.page.rig_nodes import RigNodes
from lidarplace.studio.page.scene import Scene
from lidarplace.studio.rig import Rig
from lidarplace.studio.studio import Studio

if TYPE_CHECKING:
    import viser

VIOLET = "#9c36b5"
"""Colour of all its LiDARs and points."""
GAP_M = 5.0
"""Gap between the regions of two rigs that are apart, metres."""
NODE, APART = "/other_rig", "/other_rig/apart"
FROM_ABOVE = math.radians(40)
"""Angle down to two rigs that are apart, radians."""


class OtherRig:
    """Draws the rig that the panel names, in one colour; nothing if it names none.

    Apart from the selected rig it has ground, vehicle and objects of its own."""

    def __init__(
        self, studio: Studio, server: viser.ViserServer, panel: Panel, scene: Scene
    ) -> None:
        self._studio, self._panel, self._scene = studio, panel, scene
        self._node = server.scene.add_frame(NODE, show_axes=False, visible=False)
        self._apart = server.scene.add_frame(APART, show_axes=False, visible=False)
        scene.stand(APART)
        self._nodes = RigNodes(server, (VIOLET,), NODE)
        self._lidars: Rig | None = None
        self._cloud: tuple[Placement | None, FrameView, bool] | None = None
        self._objects: tuple[Placement | None, FrameView] | None = None

    def draw(self, view: FrameView, resting: bool) -> None:
        """Draw what has changed; coarsely unless it rests."""
        studio, panel = self._studio, self._panel
        rig = next((rig for rig in studio.rigs if rig.name == panel.other_rig.value), None)
        visible = rig is not None and rig.name != studio.rig.name
        self._node.visible = visible
        if rig is None or not visible:
            return
        apart = panel.apart.value
        self._apart.visible = apart
        self._node.position = (0.0, _aside(studio.roi) if apart else 0.0, 0.0)
        if rig != self._lidars:
            self._lidars = rig
            self._nodes.lidars(rig, rig.models(studio.file.lidar), chosen=None, wrong=None)
            self._scene.poles(rig.mounts, NODE)
        placement = studio.placement_of(rig)
        self._draw_cloud(rig, placement, view, resting)
        if apart and self._objects != (placement, view):
            self._objects = (placement, view)
            self._scene.objects(view.frame.objects, view.objects(placement), APART)

    def _draw_cloud(
        self, rig: Rig, placement: Placement | None, view: FrameView, resting: bool
    ) -> None:
        """Draw points, unless the selected rig moves and these are drawn already."""
        if not self._panel.cloud.value:
            self._nodes.cloud(None, [])
            self._cloud = None
        elif self._cloud not in ((placement, view, True), (placement, view, resting)):
            self._cloud = (placement, view, resting)
            most = RESTING_POINTS if resting else MOVING_POINTS
            self._nodes.cloud(view.cloud(placement, most), rig.working)

    def turn_camera(self, client: viser.ClientHandle) -> None:
        """Let a browser see both rigs where they are apart, and else the selected one."""
        camera, roi = client.camera, self._studio.roi
        if not self._panel.apart.value or self._panel.other_rig.value == NO_RIG:
            camera.position, camera.look_at = self._scene.camera
            return
        half = 0.5 * (roi.y[1] - roi.y[0] + _aside(roi))
        away = half / (camera.aspect * math.tan(0.5 * camera.fov))
        x, y = 0.5 * sum(roi.x), roi.y[0] + half
        back, up = away * math.cos(FROM_ABOVE), away * math.sin(FROM_ABOVE)
        camera.position = (x - back, y, up)
        camera.look_at = (x, y, 0.0)


def _aside(roi: Roi) -> float:
    """Return how far the other rig is moved to the left where the two are apart, metres."""
    return roi.y[1] - roi.y[0] + GAP_M
