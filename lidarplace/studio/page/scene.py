"""Surroundings of the rig in the scene of a page: vehicle or site, ground, zones and objects."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.roi import Roi
from lidarplace.clouds.shapes import between
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.mounting.zone import Zone
from lidarplace.rigs.placement import Mount
from lidarplace.scenes.site import Obstacles
from lidarplace.studio.blind_ground import BlindGround
from lidarplace.studio.page.rig_nodes import rgb
from lidarplace.studio.rigs_file import RigsFile
from lidarplace.viewing import style
from lidarplace.viewing.solids import edges, headings, triangles

if TYPE_CHECKING:
    import viser

LANE_M = 3.5
SENSORS = ("#e8590c", "#fab005", "#82c91e", "#2b8a3e")
"""Colours of ground by the number of LiDARs that see it, the last one of three and more."""
RECALL = ("#d95f02", "#e8904f", "#f2c49b", "#eeeeee", "#a9cce3", "#5a9fce", "#1f6fb0")
"""Colours of ground by expected recall, in equal parts from 0 to 1."""
UNSEEN = "#e03131"
Camera = tuple[tuple[float, float, float], tuple[float, float, float]]
CAR: Camera = (-6.0, 4.0, 5.0), (1.5, 0.0, 0.8)
"""Where the initial camera is and looks at, metres."""
POLES: Camera = (-36.0, 24.0, 34.0), (0.0, 0.0, 0.0)
"""The same at a site."""
ROAD, WALL = (186, 194, 204), (173, 181, 189)


class Scene:
    """Draws the vehicle and zones of a file, the outline of the ROI, and objects on a server."""

    def __init__(self, server: viser.ViserServer, file: RigsFile, roi: Roi) -> None:
        self._scene, self._file, self._roi = server.scene, file, roi
        self._coloured: set[str] = set()
        self.stand("")
        for number, zone in enumerate(file.zones):
            self._lines(f"/zones/{number}", _prism(zone), "#2b8a3e", 2.0)
            x, y = np.mean(zone.polygon, axis=0).tolist()
            self._scene.add_label(f"/zones/{number}/name", zone.name, position=(x, y, zone.z[1]))
        self.camera = CAR if file.site is None else POLES
        server.initial_camera.position, server.initial_camera.look_at = self.camera

    def stand(self, node: str) -> None:
        """Draw the ground, and the vehicle or what is around a site, below a node of the scene."""
        self._vehicle(node)
        roi = self._roi
        centre = (0.5 * sum(roi.x), 0.5 * sum(roi.y), -0.01)
        self._scene.add_grid(
            f"{node}/ground", roi.x[1] - roi.x[0], roi.y[1] - roi.y[0],
            cell_size=1.0, section_size=10.0, position=centre, cell_color=(225, 228, 232),
            section_color=(190, 196, 204), fade_distance=1000.0,
        )  # fmt: skip
        if self._file.around is None:
            sides = [side * LANE_M for side in (-1.5, -0.5, 0.5, 1.5)]
            lanes = [[(roi.x[0], y, 0.0), (roi.x[1], y, 0.0)] for y in sides]
            self._lines(f"{node}/lanes", np.array(lanes), "#8d99a6", 1.5)
        else:
            self._obstacles(node, self._file.around)
        box = between(np.array([[roi.x, roi.y, roi.z]]).swapaxes(1, 2))
        self._boxes_as_lines(f"{node}/roi", box, style.OUTLINE, 1.0)

    def _vehicle(self, node: str) -> None:
        body, keep_out = self._file.vehicle, self._file.limits.keep_out
        look: dict[str, Any] = {"color": (120, 130, 142), "opacity": 1.0, "flat_shading": True}
        if len(body.boxes):
            self._mesh(f"{node}/vehicle", *triangles(between(body.boxes)), **look)
        if len(keep_out):
            out = look | {"color": (201, 42, 42), "opacity": 0.35}
            self._mesh(f"{node}/keep_out", *triangles(between(keep_out)), **out)
        if body.mesh is not None:
            self._mesh(f"{node}/vehicle_mesh", body.mesh.vertices, body.mesh.faces, **look)

    def _obstacles(self, node: str, around: Obstacles) -> None:
        look: dict[str, Any] = {"flat_shading": True, "receive_shadow": False}
        flat = np.zeros((len(around.lanes), 7))
        flat[:, [0, 1, 6]], flat[:, 3:5] = around.lanes[:, :3], 2 * around.lanes[:, 3:]
        for name, boxes, colour, opacity in (
            ("lanes", flat, ROAD, 1.0),
            ("buildings", around.buildings, WALL, 0.35),
        ):
            if len(boxes):
                vertices, faces = triangles(boxes)
                self._mesh(f"{node}/{name}", vertices, faces, color=colour, opacity=opacity, **look)

    def poles(self, mounts: Sequence[Mount], node: str = "") -> None:
        """Draw the poles of a site below a node; a vehicle has none."""
        if self._file.site is not None:
            ends = [(mount.position * [1.0, 1.0, 0.0], mount.position) for mount in mounts]
            self._lines(f"{node}/poles", np.reshape(ends, (-1, 2, 3)), style.OUTLINE, 4.0)

    def _mesh(self, name: str, vertices: NDArray[Any], faces: NDArray[Any], **look: Any) -> None:
        self._scene.add_mesh_simple(
            name, vertices.astype(np.float32), faces.astype(np.uint32), side="double",
            cast_shadow=False, **look,
        )  # fmt: skip

    def _lines(self, name: str, segments: NDArray[np.floating], colour: str, width: float) -> None:
        """Draw segments of shape (n, 2, 3)."""
        if len(segments):
            self._scene.add_line_segments(
                name, segments.astype(np.float32), rgb(colour), thickness=width,
                thickness_units="screen",
            )  # fmt: skip
        else:
            self._scene.remove_by_name(name)

    def _boxes_as_lines(self, name: str, boxes: NDArray[Any], colour: str, width: float) -> None:
        line = np.concatenate([edges(boxes), headings(boxes).reshape(-1, 3)])
        pairs = np.stack([line[:-1], line[1:]], axis=1)
        self._lines(name, pairs[np.isfinite(pairs).all(axis=(1, 2))], colour, width)

    def objects(self, boxes: pd.DataFrame, objects: pd.DataFrame, node: str = "") -> None:
        """Draw boxes below a node; those of `FrameView.objects` that no LiDAR sees in thick red."""
        unseen = boxes.index.isin(objects.index[objects["points"] == 0])
        missed = pd.Series(unseen, boxes.index)
        classes = [(n, (boxes["class"] == n) & ~missed, c, 1.5) for n, c in style.CLASSES.items()]
        for name, mask, colour, width in (*classes, ("unseen", missed, UNSEEN, 3.0)):
            rows = boxes.loc[mask, list(GEOMETRY)].to_numpy(np.float64)
            self._boxes_as_lines(f"{node}/objects/{name}", rows, colour, width)

    def blind(self, ground: BlindGround | None) -> None:
        """Draw the cells of the ground in which too little is seen, or all by sensors or recall."""
        levels = np.empty(0, np.int64) if ground is None else _levels(ground)
        names = {f"/blind/{level}": level for level in np.unique(levels).tolist()}
        for name in self._coloured - names.keys():
            self._scene.remove_by_name(name)
        self._coloured = set(names)
        if ground is not None:
            colours = SENSORS if ground.recall is None else RECALL
            for name, level in names.items():
                middles = ground.middles[levels == level]
                self._cells(name, middles, 0.5 * ground.edge, colours[level])

    def _cells(self, name: str, middles: NDArray[np.float64], half: float, colour: str) -> None:
        corners = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
        flat = (middles[:, None] + corners).reshape(-1, 2)
        vertices = np.concatenate([flat, np.full((len(flat), 1), 0.02)], axis=1)
        first = 4 * np.arange(len(middles))[:, None, None]
        faces = (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
        self._mesh(name, vertices, faces, color=rgb(colour), opacity=0.45, receive_shadow=False)


def _levels(ground: BlindGround) -> NDArray[np.int64]:
    """Return the number of the colour of each cell."""
    if ground.recall is not None:
        return np.minimum(len(RECALL) * ground.recall, len(RECALL) - 1).astype(np.int64)
    sensors = np.zeros(len(ground.middles), np.int64) if ground.sensors is None else ground.sensors
    return np.minimum(sensors, len(SENSORS) - 1)


def _prism(zone: Zone) -> NDArray[np.float64]:
    """Return the edges of a zone, shape (n, 2, 3)."""
    low, high = zone.z
    sides = list(zip(zone.polygon, (*zone.polygon[1:], zone.polygon[0]), strict=True))
    rings = [[(*a, z), (*b, z)] for a, b in sides for z in (low, high)]
    return np.array([*rings, *([(*a, low), (*a, high)] for a, _ in sides)], np.float64)
