"""When and how a page shows what a studio has become: at once and coarsely while something moves,
fully when it rests, in the order in which a hand wants to see it."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Coroutine
from typing import TYPE_CHECKING, Any

from lidarplace.studio.blind_ground import COUNTED_M, HEIGHTS_M, BlindGround
from lidarplace.studio.frame_view import MOVING_POINTS, RESTING_POINTS
from lidarplace.studio.page.beside import Beside
from lidarplace.studio.page.dragged import quaternion
from lidarplace.studio.page.editing import Editing
from lidarplace.studio.page.panel import NO_OBJECT, NOBODY, Panel
from lidarplace.studio.page.rig_nodes import RigNodes
from lidarplace.studio.page.scene import Scene
from lidarplace.studio.page.tables import (
    Row,
    numbers_table,
    object_answer,
    unseen_list,
    violations_list,
)
from lidarplace.studio.studio import Studio
from lidarplace.viewing import style

if TYPE_CHECKING:
    import viser

REST_S = 0.25
"""Nothing has changed for so long: it rests."""


class Redraw:
    """A thread that draws after each change; changes that come while it draws are drawn together.

    Args:
        draw: called with True for what rests, with False for what moves.
        failed: called with what `draw` raised; the thread goes on.
    """

    def __init__(self, draw: Callable[[bool], None], failed: Callable[[Exception], None]) -> None:
        self._draw, self._failed = draw, failed
        self._changed = threading.Condition()
        self._wanted: bool | None = None  # None: nothing has changed
        self._ended = False
        self._thread = threading.Thread(target=self._run, daemon=True, name="redraw")
        self._thread.start()

    def ask(self, resting: bool = True) -> None:
        """Something has changed; `resting` unless more of it is to come."""
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
                self._changed.wait_for(
                    lambda: self._ended or self._wanted is not None, timeout=patience
                )
                if self._ended:
                    return
                resting = True if self._wanted is None else self._wanted
                self._wanted = None
            try:
                self._draw(resting)
            except Exception as error:  # of a rig that cannot be drawn; the next one may
                self._failed(error)
            coarse = not resting


class Drawing:
    """Draws a studio on a server and its panel.

    Args:
        pulled: is told of each pull at the handle.

    Attributes:
        beside: draws another rig.
    """

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
        self.beside = Beside(studio, server, panel, self._scene)
        self._pulled = pulled
        self._handle: viser.TransformControlsHandle | None = None
        self._ground: BlindGround | None = None  # on which too little is seen
        self._drawn: object = None  # rig and LiDAR whose solids stand in the scene

    def draw(self, resting: bool) -> None:
        """Draw all that is shown; coarsely unless it rests."""
        studio, panel = self._studio, self._panel
        rig = studio.rig
        self._editing.still_there()
        ground = self._ground = self._too_little(resting)
        self._draw_numbers(resting, ground)
        self._server.flush()
        self._draw_lidars(resting)
        view, placement = studio.view, studio.placement
        working = [n for n, lidar in enumerate(rig.lidars) if lidar.enabled]
        most = RESTING_POINTS if resting else MOVING_POINTS
        cloud = view.cloud(placement, most) if panel.cloud.value else None
        with self._server.atomic():
            self._nodes.cloud(cloud, working)
        self._server.flush()
        objects = view.objects(placement)
        self._scene.objects(view.frame.objects, objects)
        panel.unseen.content = unseen_list(objects)
        self._scene.blind(ground)
        self.beside.draw(view, resting)
        if resting:
            panel.violations.content = violations_list(studio.violations())
            ids = view.frame.objects["object_id"].astype(str).tolist()
            fields = asyncio.run_coroutine_threadsafe(
                self._draw_fields(ids), self._server.get_event_loop()
            )
            fields.result()
            self._draw_answer()
        self._server.flush()

    async def _draw_fields(self, objects: list[str]) -> None:
        """Where edits are heard, too: nothing typed is overwritten before it is read."""
        self._panel.show(self._studio, self._editing.chosen)
        self._panel.show_objects(objects)

    def _too_little(self, resting: bool) -> BlindGround | None:
        """Where too little is seen, if somebody wants to see it.

        What a requirement finds takes longer than a hand waits: while something moves it stays.
        """
        asked = self._panel.ground.value
        if asked == NOBODY:
            return None
        if asked in HEIGHTS_M:
            return self._studio.blind_ground(HEIGHTS_M[asked])
        if asked in COUNTED_M:
            return self._studio.counted_ground(COUNTED_M[asked])
        return self._studio.failing_ground(asked) if resting else self._ground

    def _draw_numbers(self, resting: bool, ground: BlindGround | None) -> None:
        studio = self._studio
        begun = studio.totals_begun
        others: list[Row] = [
            (name, total, begun[name], ",.6g") for name, total in studio.totals.items()
        ]
        if ground is not None:
            asked = self._panel.ground.value
            label = f"Blind for {asked}, %" if asked in HEIGHTS_M else f"Fails: {asked}, %"
            label = f"Less than 2 {asked}, %" if asked in COUNTED_M else label
            others.append((label, 100 * ground.share, None, ".1f"))
        self._panel.numbers.content = numbers_table(
            studio.numbers(resting), studio.numbers_begun(resting), studio.meter.h_pog, others
        )

    def _draw_lidars(self, resting: bool) -> None:
        """While one is dragged its own solid alone moves: the rest is as it was."""
        rig, chosen = self._studio.rig, self._editing.chosen
        if not resting and chosen is not None:
            self._nodes.move(chosen, rig.mounts[chosen])
            return
        drawn = (rig, chosen)
        if drawn == self._drawn:
            return
        self._drawn = drawn
        wrong = {number for own in self._studio.misplaced() for number in own.lidars}
        with self._server.atomic():
            self._nodes.lidars(rig, rig.models(self._studio.lidar), chosen, wrong)
            self._draw_handle(chosen)

    def _draw_handle(self, chosen: int | None) -> None:
        """The handle of the chosen LiDAR; it is one for all of them."""
        if chosen is None:
            if self._handle is not None:
                self._handle.visible = False
            return
        mount = self._studio.rig.mounts[chosen]
        if self._handle is None:
            self._handle = self._server.scene.add_transform_controls(
                "/handle", scale=1.0, line_width=3.0, depth_test=False
            )
            self._handle.on_update(self._pulled)
        self._handle.position = mount.position
        self._handle.wxyz = quaternion(mount)
        self._handle.visible = True

    def _draw_answer(self) -> None:
        chosen = self._panel.object.value
        if chosen == NO_OBJECT or self._studio.placement is None:
            self._panel.answer.content = ""
            return
        rays = self._studio.why_unseen(chosen)
        objects = self._studio.view.objects(self._studio.placement)
        self._panel.answer.content = object_answer(objects, chosen, rays)
