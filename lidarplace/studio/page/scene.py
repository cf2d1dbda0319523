"""What stands in the scene of a page: vehicle, ground, zones, LiDARs, objects and their points."""

from __future__ import annotations

import math
from collections.abc import Collection
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.boxes import GEOMETRY
from lidarplace.catalogue.datasheet import catalogue
from lidarplace.mounting.zone import Zone
from lidarplace.placement import Mount
from lidarplace.roi import Roi
from lidarplace.sensor import Lidar
from lidarplace.studio.blind_ground import BlindGround
from lidarplace.studio.frame_view import SimulatedCloud
from lidarplace.studio.page.dragged import quaternion
from lidarplace.studio.rig import Rig
from lidarplace.studio.rigs_file import RigsFile
from lidarplace.viewing import style
from lidarplace.viewing.solids import edges, headings, triangles

if TYPE_CHECKING:
    import viser

SIZE_M = (0.1, 0.1, 0.07)
"""Of a LiDAR whose size is not known."""
VIEW_M = 0.6
"""How far the lines of a field of view reach."""
LANE_M = 3.5
BLIND, DEAD = "#e8590c", "#bbbbbb"
UNSEEN = "#e03131"


class Scene:
    """Draws on a server.

    Args:
        server: of the page.
        file: vehicle, zones and what is kept out.
        roi: its outline is drawn.
    """

    def __init__(self, server: viser.ViserServer, file: RigsFile, roi: Roi) -> None:
        self._scene, self._file = server.scene, file
        self._lidars: list[viser.SceneNodeHandle] = []
        self._ground(roi)
        self._vehicle(file)
        for number, zone in enumerate(file.zones):
            self._lines(f"/zones/{number}", _prism(zone), "#2b8a3e", 2.0)
            self._scene.add_label(f"/zones/{number}/name", zone.name, position=_top(zone))
        unseen = np.zeros((1, 3))  # a cloud without points cannot be drawn
        self._cloud = self._scene.add_point_cloud(
            "/cloud", unseen, unseen, point_size=0.03, point_shading="flat", visible=False
        )
        server.initial_camera.position = (-6.0, 4.0, 5.0)
        server.initial_camera.look_at = (1.5, 0.0, 0.8)

    def _ground(self, roi: Roi) -> None:
        middle = (0.5 * sum(roi.x), 0.5 * sum(roi.y), -0.01)
        self._scene.add_grid(
            "/ground", roi.x[1] - roi.x[0], roi.y[1] - roi.y[0],
            cell_size=1.0, section_size=10.0, position=middle, cell_color=(225, 228, 232),
            section_color=(190, 196, 204), fade_distance=1000.0,
        )  # fmt: skip
        sides = [side * LANE_M for side in (-1.5, -0.5, 0.5, 1.5)]
        lanes = [[(roi.x[0], y, 0.0), (roi.x[1], y, 0.0)] for y in sides]
        self._lines("/lanes", np.array(lanes), "#8d99a6", 1.5)
        centre = [0.5 * (low + high) for low, high in (roi.x, roi.y, roi.z)]
        size = [high - low for low, high in (roi.x, roi.y, roi.z)]
        self._boxes_as_lines("/roi", np.array([[*centre, *size, 0.0]]), style.OUTLINE, 1.0)

    def _vehicle(self, file: RigsFile) -> None:
        for name, boxes, colour, opacity in (
            ("/vehicle", file.vehicle.boxes, (120, 130, 142), 1.0),
            ("/keep_out", file.keep_out, (201, 42, 42), 0.35),
        ):
            if len(boxes):
                middles, sizes = boxes.mean(axis=1), boxes[:, 1] - boxes[:, 0]
                rows = np.concatenate([middles, sizes, np.zeros((len(boxes), 1))], axis=1)
                self._surface(name, *triangles(rows), colour, opacity)
        mesh = file.vehicle.mesh
        if mesh is not None:
            self._surface("/vehicle_mesh", mesh.vertices, mesh.faces, (120, 130, 142), 1.0)

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

    def lidars(
        self,
        rig: Rig,
        models: tuple[Lidar, ...],
        chosen: int | None,
        wrong: Collection[int],
    ) -> None:
        """Draw all LiDARs in their size, with what they have in view.

        Lines of the chosen one are thicker; those in `wrong`, which do not keep a constraint, have
        a cross at their number.
        """
        for node in self._lidars:
            node.remove()
        self._lidars = []
        colours = iter(style.COLOURS * (1 + len(rig.lidars) // len(style.COLOURS)))
        sheets = catalogue()
        for number, (mount, lidar) in enumerate(zip(rig.mounts, models, strict=True)):
            works = rig.lidars[number].enabled
            colour = rgb(next(colours) if works else DEAD)
            sheet = sheets.get(rig.lidars[number].model or self._file.settings.lidar.name or "")
            size = SIZE_M if sheet is None or sheet.size_mm is None else sheet.size_mm
            if size is not SIZE_M:
                size = (size[0] / 1000, size[1] / 1000, size[2] / 1000)
            at = mount.position
            name = f"/lidars/{number}"
            self._lidars.append(
                self._scene.add_frame(name, show_axes=False, wxyz=quaternion(mount), position=at)
            )
            self._scene.add_box(f"{name}/body", colour, size, cast_shadow=False)
            self._scene.add_line_segments(
                f"{name}/view", _view(lidar), colour, thickness_units="screen",
                thickness=2.5 if number == chosen else 1.0,
            )  # fmt: skip
            label = f"{number}{' ✗' if number in wrong else ''}{'' if works else ' (dead)'}"
            self._scene.add_label(f"{name}/name", label, position=(0, 0, 0.4))

    def move(self, number: int, mount: Mount) -> None:
        """Put a LiDAR elsewhere, nothing else having changed."""
        if number < len(self._lidars):
            self._lidars[number].position = mount.position
            self._lidars[number].wxyz = quaternion(mount)

    def cloud(self, cloud: SimulatedCloud | None, working: list[int]) -> None:
        """Draw points in the colours of their LiDARs; `working` are those of the cloud."""
        self._cloud.visible = cloud is not None and len(cloud.points) > 0
        if cloud is None or not len(cloud.points):
            return
        table = np.array([rgb(colour) for colour in style.COLOURS], np.uint8)
        self._cloud.points = cloud.points.astype(np.float16)
        self._cloud.colors = table[np.array(working, np.int64)[cloud.lidar] % len(table)]

    def objects(self, boxes: pd.DataFrame, objects: pd.DataFrame) -> None:
        """Draw the boxes of a frame, those that count and that no LiDAR sees in red, and thick.

        Args:
            boxes: rows of the box log.
            objects: of `FrameView.objects`.
        """
        unseen = set(objects.index[objects["points"] == 0])
        missed = boxes.index.isin(list(unseen))
        for name, shade in style.CLASSES.items():
            own = boxes[(boxes["class"] == name) & ~missed]
            self._boxes_as_lines(
                f"/objects/{name}", own[list(GEOMETRY)].to_numpy(np.float64), shade, 1.5
            )
        rows = boxes.loc[missed, list(GEOMETRY)].to_numpy(np.float64)
        self._boxes_as_lines("/objects/unseen", rows, UNSEEN, 3.0)

    def blind(self, ground: BlindGround | None) -> None:
        """Draw the cells of the ground in which too little is seen."""
        if ground is None or not len(ground.middles):
            self._scene.remove_by_name("/blind")
            return
        half = 0.5 * ground.edge
        corners = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
        flat = (ground.middles[:, None] + corners).reshape(-1, 2)
        vertices = np.concatenate([flat, np.full((len(flat), 1), 0.02)], axis=1)
        first = 4 * np.arange(len(ground.middles))[:, None, None]
        faces = (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
        self._scene.add_mesh_simple(
            "/blind", vertices.astype(np.float32), faces.astype(np.uint32), color=rgb(BLIND),
            opacity=0.45, side="double", cast_shadow=False, receive_shadow=False,
        )  # fmt: skip


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue of `#rrggbb`."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:], 16)


def _view(lidar: Lidar) -> NDArray[np.float32]:
    """Lines of the lowest and the highest beam in the sensor's frame, and where they begin."""
    low, high = lidar.azimuth
    turns = np.linspace(low, high, 25)
    rings, found = [], []
    for elevation in (min(lidar.elevations), max(lidar.elevations)):
        ring = VIEW_M * np.stack(
            [
                math.cos(elevation) * np.cos(turns),
                math.cos(elevation) * np.sin(turns),
                np.full(len(turns), math.sin(elevation)),
            ],
            axis=1,
        )
        rings.append(ring)
        found += list(pairwise(ring))
    if not lidar.full_turn:
        found += [(np.zeros(3), ring[end]) for ring in rings for end in (0, -1)]
    found.append((np.zeros(3), np.array([VIEW_M, 0.0, 0.0])))
    return np.array(found, np.float32)


def _prism(zone: Zone) -> NDArray[np.float64]:
    """The edges of a zone, shape (n, 2, 3)."""
    low, high = zone.z
    sides = list(zip(zone.polygon, (*zone.polygon[1:], zone.polygon[0]), strict=True))
    rings = [[(*a, z), (*b, z)] for a, b in sides for z in (low, high)]
    return np.array([*rings, *([(*a, low), (*a, high)] for a, _ in sides)], np.float64)


def _top(zone: Zone) -> tuple[float, float, float]:
    x, y = np.mean(zone.polygon, axis=0).tolist()
    return x, y, zone.z[1]
