"""What stands around the rig in the scene of a page: vehicle, ground, zones and objects."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.roi import Roi
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.mounting.zone import Zone
from lidarplace.studio.blind_ground import BlindGround
from lidarplace.studio.page.rig_nodes import rgb
from lidarplace.studio.rigs_file import RigsFile
from lidarplace.viewing import style
from lidarplace.viewing.solids import between, edges, headings, triangles

if TYPE_CHECKING:
    import viser

LANE_M = 3.5
BLIND = "#e8590c"
SENSORS = (BLIND, "#fab005", "#82c91e", "#2b8a3e")
"""Of ground by the number of LiDARs that see it, the last one of three and more."""
UNSEEN = "#e03131"
EYE, LOOKS_AT = (-6.0, 4.0, 5.0), (1.5, 0.0, 0.8)
"""Of the camera at the beginning, metres."""


class Scene:
    """Draws on a server.

    Args:
        server: of the page.
        file: vehicle, zones and what is kept out.
        roi: its outline is drawn.
    """

    def __init__(self, server: viser.ViserServer, file: RigsFile, roi: Roi) -> None:
        self._scene, self._file, self._roi = server.scene, file, roi
        self._coloured: set[str] = set()
        self.stand("")
        for number, zone in enumerate(file.zones):
            self._lines(f"/zones/{number}", _prism(zone), "#2b8a3e", 2.0)
            self._scene.add_label(f"/zones/{number}/name", zone.name, position=_top(zone))
        server.initial_camera.position, server.initial_camera.look_at = EYE, LOOKS_AT

    def stand(self, below: str) -> None:
        """Draw ground and vehicle below a node of the scene."""
        self._ground(below)
        self._vehicle(below)

    def _ground(self, below: str) -> None:
        roi = self._roi
        middle = (0.5 * sum(roi.x), 0.5 * sum(roi.y), -0.01)
        self._scene.add_grid(
            f"{below}/ground", roi.x[1] - roi.x[0], roi.y[1] - roi.y[0],
            cell_size=1.0, section_size=10.0, position=middle, cell_color=(225, 228, 232),
            section_color=(190, 196, 204), fade_distance=1000.0,
        )  # fmt: skip
        sides = [side * LANE_M for side in (-1.5, -0.5, 0.5, 1.5)]
        lanes = [[(roi.x[0], y, 0.0), (roi.x[1], y, 0.0)] for y in sides]
        self._lines(f"{below}/lanes", np.array(lanes), "#8d99a6", 1.5)
        box = between(np.array([[roi.x, roi.y, roi.z]]).swapaxes(1, 2))
        self._boxes_as_lines(f"{below}/roi", box, style.OUTLINE, 1.0)

    def _vehicle(self, below: str) -> None:
        file = self._file
        for name, boxes, colour, opacity in (
            (f"{below}/vehicle", file.vehicle.boxes, (120, 130, 142), 1.0),
            (f"{below}/keep_out", file.keep_out, (201, 42, 42), 0.35),
        ):
            if len(boxes):
                self._surface(name, *triangles(between(boxes)), colour, opacity)
        mesh = file.vehicle.mesh
        if mesh is not None:
            self._surface(f"{below}/vehicle_mesh", mesh.vertices, mesh.faces, (120, 130, 142), 1.0)

    def _surface(
        self,
        name: str,
        vertices: NDArray[np.floating],
        faces: NDArray[np.integer],
        colour: tuple[int, int, int],
        opacity: float,
    ) -> None:
        self._scene.add_mesh_simple(
            name, vertices.astype(np.float32), faces, color=colour, opacity=opacity,
            flat_shading=True, side="double", cast_shadow=False,
        )  # fmt: skip

    def _lines(self, name: str, segments: NDArray[np.floating], colour: str, width: float) -> None:
        """Segments of shape (n, 2, 3)."""
        if len(segments):
            self._scene.add_line_segments(
                name, segments.astype(np.float32), rgb(colour), thickness=width,
                thickness_units="screen",
            )  # fmt: skip
        else:
            self._scene.remove_by_name(name)

    def _boxes_as_lines(
        self, name: str, boxes: NDArray[np.float64], colour: str, width: float
    ) -> None:
        line = np.concatenate([edges(boxes), headings(boxes).reshape(-1, 3)])
        pairs = np.stack([line[:-1], line[1:]], axis=1)
        self._lines(name, pairs[np.isfinite(pairs).all(axis=(1, 2))], colour, width)

    def objects(self, boxes: pd.DataFrame, objects: pd.DataFrame, below: str = "") -> None:
        """Draw the boxes of a frame, those that count and that no LiDAR sees in red, and thick.

        Args:
            boxes: rows of the box log.
            objects: of `FrameView.objects`.
            below: a node of the scene.
        """
        unseen = set(objects.index[objects["points"] == 0])
        missed = boxes.index.isin(list(unseen))
        for name, shade in style.CLASSES.items():
            own = boxes[(boxes["class"] == name) & ~missed]
            self._boxes_as_lines(
                f"{below}/objects/{name}", own[list(GEOMETRY)].to_numpy(np.float64), shade, 1.5
            )
        rows = boxes.loc[missed, list(GEOMETRY)].to_numpy(np.float64)
        self._boxes_as_lines(f"{below}/objects/unseen", rows, UNSEEN, 3.0)

    def blind(self, ground: BlindGround | None) -> None:
        """Draw the cells of the ground in which too little is seen, or all by their sensors."""
        for number, colour in enumerate(SENSORS):
            name, middles = f"/blind/{number}", np.empty((0, 2))
            if ground is not None and ground.sensors is not None:
                own = np.minimum(ground.sensors, len(SENSORS) - 1) == number
                middles = ground.middles[own]
            elif ground is not None and number == 0:
                middles = ground.middles
            if len(middles):
                self._cells(name, middles, 0.5 * ground.edge if ground else 0.0, colour)
                self._coloured.add(name)
            elif name in self._coloured:
                self._scene.remove_by_name(name)
                self._coloured.remove(name)

    def _cells(self, name: str, middles: NDArray[np.float64], half: float, colour: str) -> None:
        corners = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
        flat = (middles[:, None] + corners).reshape(-1, 2)
        vertices = np.concatenate([flat, np.full((len(flat), 1), 0.02)], axis=1)
        first = 4 * np.arange(len(middles))[:, None, None]
        faces = (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
        self._scene.add_mesh_simple(
            name, vertices.astype(np.float32), faces.astype(np.uint32), color=rgb(colour),
            opacity=0.45, side="double", cast_shadow=False, receive_shadow=False,
        )  # fmt: skip


def _prism(zone: Zone) -> NDArray[np.float64]:
    """The edges of a zone, shape (n, 2, 3)."""
    low, high = zone.z
    sides = list(zip(zone.polygon, (*zone.polygon[1:], zone.polygon[0]), strict=True))
    rings = [[(*a, z), (*b, z)] for a, b in sides for z in (low, high)]
    return np.array([*rings, *([(*a, low), (*a, high)] for a, _ in sides)], np.float64)


def _top(zone: Zone) -> tuple[float, float, float]:
    x, y = np.mean(zone.polygon, axis=0).tolist()
    return x, y, zone.z[1]
