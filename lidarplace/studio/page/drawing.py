"""Drawing of a studio on a page: at once and coarsely while something moves, later fully."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Coroutine
from typing import TYPE_CHECKING, Any

from lidarplace.studio.blind_ground import COUNTED_M, FINDING, HEIGHTS_M, BlindGround
from lidarplace.studio.frame_view import MOVING_POINTS, RESTING_POINTS
from lidarplace.studio.page import tables
from lidarplace.studio.page.editing import Editing
from lidarplace.studio.page.other_rig import OtherRig
from lidarplace.studio.page.panel import NO_COLOUR, NO_OBJECT, Panel
from lidarplace.studio.page.rig_nodes import RigNodes, quaternion
from lidarplace.studio.page.scene import Scene
from lidarplace.studio.studio import Studio
from lidarplace.viewing import style

if TYPE_CHECKING:
    import viser

REST_S = 0.25
"""Time without a change after which it rests, seconds."""


class Redraw:
    """A thread that draws after each change; changes that come while it draws are drawn together.

    `draw` is called with whether the rig rests, `failed` with what it raised; then it goes on."""

    def __init__(self, draw: Callable[[bool], None], failed: Callable[[Exception], None]) -> None:
        self._draw, self._failed = draw, failed
        self._changed = threading.Condition()
        self._wanted: bool | None = None  # None: nothing has changed
        self._ended = False
        self._thread = threading.Thread(target=self._run, daemon=True, name="redraw")
        self._thread.start()

    def ask(self, resting: bool = True) -> None:
        """Report a change; `resting` unless more of it is to come."""
        with self._changed:
            self._wanted = resting
            self._changed.notify()

    def end(self) -> None:
        """Draw no more, and wait until nothing is drawn."""
        with self._changed:
            self._ended = True
            self._changed.notify()
        self._thread.join()

    def _run(self) -> None:
        coarse = False  # what is on the page
        while True:
            with self._changed:
                patience = REST_S if coarse else None
                self._changed.wait_for(lambda: self._ended or self._wanted is not None, patience)
                if self._ended:
                    return
                resting, self._wanted = self._wanted is not False, None
            try:
                self._draw(resting)
            except Exception as error:  # of a rig that cannot be drawn; the next one may
                self._failed(error)
            coarse = not resting


class Drawing:
    """Draws a studio on a server and its panel; `pulled` receives each pull at the handle."""

    def __init__(
        self,
        studio: Studio,
        server: viser.ViserServer,
        panel: Panel,
        editing: Editing,
        pulled: Callable[[Any], Coroutine[Any, Any, None]],
    ) -> None:
        self._studio, self._server, self._panel, self._editing = studio, server, panel, editing
        self._scene = Scene(server, studio.file, studio.roi)
        self._nodes = RigNodes(server, style.COLOURS)
        self.other_rig = OtherRig(studio, server, panel, self._scene)
        self._handle = server.scene.add_transform_controls(
            "/handle", scale=1.0, line_width=3.0, depth_test=False, visible=False
        )
        self._handle.on_update(pulled)
        self._ground: BlindGround | None = None  # that is coloured
        self._drawn: object = None  # rig and LiDAR whose solids stand in the scene

    def draw(self, resting: bool) -> None:
        """Draw all that is visible; coarsely unless it rests."""
        studio, panel, rig = self._studio, self._panel, self._studio.rig
        self._editing.choose_existing()
        group = panel.ground.value
        if group == NO_COLOUR:
            self._ground = None
        elif resting or group in {*HEIGHTS_M, *COUNTED_M}:  # others are slower than a hand
            self._ground = studio.ground(group)
        self._draw_numbers(resting, group)
        self._server.flush()
        self._draw_lidars(resting)
        self._scene.poles(rig.mounts)
        view, placement = studio.view, studio.placement
        most = RESTING_POINTS if resting else MOVING_POINTS
        cloud = view.cloud(placement, most) if panel.cloud.value else None
        with self._server.atomic():
            self._nodes.cloud(cloud, rig.working)
        self._server.flush()
        objects = view.objects(placement)
        self._scene.objects(view.frame.objects, objects)
        panel.unseen.content = tables.unseen_list(objects)
        self._scene.blind(self._ground)
        self.other_rig.draw(view, resting)
        if resting:
            panel.violations.content = tables.violations_list(studio.violations())
            ids = view.frame.objects["object_id"].astype(str).tolist()
            loop = self._server.get_event_loop()
            asyncio.run_coroutine_threadsafe(self._draw_fields(ids), loop).result()
            self._draw_answer()
        self._server.flush()

    async def _draw_fields(self, objects: list[str]) -> None:
        """Draw on the event loop of edits: nothing typed is overwritten before it is read."""
        self._panel.show(self._studio, self._editing.chosen)
        self._panel.show_objects(objects)

    def _draw_numbers(self, resting: bool, group: str) -> None:
        studio, rig = self._studio, self._studio.initial
        initial, now = studio.totals(rig), studio.totals()
        others: list[tables.Row] = [(name, now[name], initial[name], ",.6g") for name in now]
        if self._ground is not None:
            label = f"{group[0].upper()}{group[1:]}" if group in HEIGHTS_M else f"Fails: {group}"
            label = f"Less than 2 {group}" if group in COUNTED_M else label
            label = f"Mean {group} on the ground" if group in FINDING else label
            others.append((f"{label}, %", 100 * self._ground.share, None, ".1f"))
        numbers = studio.numbers(resting), studio.numbers(resting, rig)
        self._panel.numbers.content = tables.numbers_table(*numbers, studio.meter.h_pog, others)

    def _draw_lidars(self, resting: bool) -> None:
        """Draw all LiDARs; while one is dragged only its own solid moves."""
        rig, chosen = self._studio.rig, self._editing.chosen
        if not resting and chosen is not None:
            self._nodes.move(chosen, rig.mounts[chosen])
            return
        if (rig, chosen) == self._drawn:
            return
        self._drawn = rig, chosen
        wrong = {number for violation in self._studio.misplaced() for number in violation.lidars}
        with self._server.atomic():
            self._nodes.lidars(rig, rig.models(self._studio.file.lidar), chosen, wrong)
            self._handle.visible = chosen is not None
            if chosen is not None:
                self._handle.position = rig.mounts[chosen].position
                self._handle.wxyz = quaternion(rig.mounts[chosen])

    def _draw_answer(self) -> None:
        chosen = self._panel.object.value
        if chosen == NO_OBJECT or self._studio.placement is None:
            self._panel.answer.content = ""
            return
        objects = self._studio.view.objects(self._studio.placement)
        rays = self._studio.why_unseen(chosen)
        self._panel.answer.content = tables.object_answer(objects, chosen, rays)
