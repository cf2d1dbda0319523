"""A studio in the browser: what a person does on the page, and what is drawn for it.

Edits come from the server's event loop, one after the other, and change the state alone; a thread
draws what the state has become (`lidarplace.studio.page.redraw`). All browsers see the same rigs.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lidarplace.studio.blind_ground import HEIGHTS_M, BlindGround
from lidarplace.studio.frame_view import MOVING_POINTS, RESTING_POINTS
from lidarplace.studio.page.dragged import dragged, quaternion
from lidarplace.studio.page.panel import (
    FROM_FILE,
    NO_LIDAR,
    NO_OBJECT,
    NOBODY,
    Panel,
    assign,
)
from lidarplace.studio.page.redraw import Redraw
from lidarplace.studio.page.scene import Scene
from lidarplace.studio.page.tables import (
    Row,
    message,
    numbers_table,
    object_answer,
    unseen_list,
    violations_list,
)
from lidarplace.studio.studio import Studio

if TYPE_CHECKING:
    import viser

PLAY_S = 0.2
"""Between two frames that are played."""

_Event = Callable[[Any], Coroutine[Any, Any, None]]


class Page:
    """Shows a studio on a server, until `close`.

    Args:
        studio: the state; edits from elsewhere are shown after `refresh`.
        server: of `lidarplace.studio.page.server.serving`.
        log: folder of the box log for sweeps of the rigs; None if there is none.
    """

    def __init__(self, studio: Studio, server: viser.ViserServer, log: Path | None) -> None:
        self.studio, self._server, self._log = studio, server, log
        self.chosen: int | None = 0 if studio.rig.lidars else None
        studio.meter  # noqa: B018 - takes seconds, before anybody waits for it
        self._scene = Scene(server, studio.file, studio.roi)
        self.panel = Panel(server, studio)
        self._handle: viser.TransformControlsHandle | None = None
        self._drawn: object = None  # rig and LiDAR whose solids stand in the scene
        self._overwrite: Callable[[], str] | None = None
        self._closed = threading.Event()
        self._redraw = Redraw(self._draw, lambda error: self._say(str(error), good=False))
        self._listen()
        self._player = threading.Thread(target=self._play, daemon=True, name="play")
        self._player.start()
        self.refresh()

    def close(self) -> None:
        """Draw no more."""
        self._closed.set()
        self._player.join()
        self._redraw.end()

    def refresh(self, resting: bool = True) -> None:
        """Draw what the studio has become."""
        self._redraw.ask(resting)

    # What a person does.

    def _listen(self) -> None:
        panel = self.panel
        for name, field in panel.pose.items():
            field.on_update(self._edit(self._typed(name)))
        panel.rig.on_update(self._edit(self._choose_rig))
        panel.lidar.on_update(self._edit(self._choose_lidar))
        panel.history.on_click(self._edit(lambda value: getattr(self.studio, value)()))
        panel.model.on_update(self._edit(self._model))
        panel.works.on_update(self._edit(lambda works: self.studio.enable(self._one(), works)))
        panel.change.on_click(self._edit(self._change))
        panel.frame.on_update(
            self._edit(lambda n: self.studio.show_frame(self.studio.frame_numbers[n]))
        )
        for shown in (panel.cloud, panel.blind, panel.object):
            shown.on_update(self._edit(lambda _: None))
        panel.improve.on_click(lambda _: self._improve())
        panel.copy.on_click(self._edit(lambda _: self.studio.copy_rig(panel.new_rig.value)))
        panel.save.on_click(self._edit(lambda _: self._write(self._save)))
        panel.sweep.on_click(self._edit(lambda _: self._write(self._sweep)))
        panel.overwrite.on_click(self._edit(lambda _: self._confirm()))

    def _edit(self, act: Callable[[Any], object]) -> _Event:
        """An event that changes the studio; a mistake is told on the page."""

        async def done(event: Any) -> None:
            if event.client is None:  # the panel was brought up to date by us
                return
            self._say("")
            self.panel.overwrite.visible = False
            try:
                act(event.target.value)
            except (ValueError, OSError) as error:
                self._say(str(error), good=False)
            self.refresh()

        return done

    def _one(self) -> int:
        """The chosen LiDAR, which somebody else may have taken away."""
        number = len(self.studio.rig.lidars)
        if self.chosen is None or not number:
            raise ValueError("there is no LiDAR; add one")
        return min(self.chosen, number - 1)

    def _typed(self, name: str) -> Callable[[float], None]:
        return lambda value: self.studio.pose(self._one(), **{name: float(value)})

    def _choose_rig(self, name: str) -> None:
        self.studio.choose(name)
        self.chosen = 0 if self.studio.rig.lidars else None

    def _choose_lidar(self, label: str) -> None:
        self.chosen = None if label == NO_LIDAR else int(label.partition(":")[0])

    def _model(self, name: str) -> None:
        self.studio.model(self._one(), None if name == FROM_FILE else name)

    def _change(self, what: str) -> None:
        studio = self.studio
        if what == "add":
            top = studio.file.vehicle.height
            studio.add(x=0.0, y=0.0, z=round(top + 0.3, 3))
        elif what == "remove":
            studio.remove(self._one())
        elif what == "to zone":
            studio.snap(self._one())
        else:
            getattr(studio, what)(self._one())
        number = len(studio.rig.lidars)
        if what in ("add", "duplicate", "mirror"):
            self.chosen = number - 1

    async def _dragged(self, event: viser.TransformControlsEvent) -> None:
        number = self.chosen
        if number is None or number >= len(self.studio.rig.lidars):
            return
        if event.phase == "end":
            self.studio.drop()
            self.refresh()
            return
        handle = event.target
        moved = dragged(self.studio.rig.pose(number), handle.position, handle.wxyz)
        if not moved:
            return
        try:
            self.studio.drag(number, **moved)
        except ValueError as error:  # such as below the ground
            self._say(str(error), good=False)
        self.refresh(resting=False)

    def _improve(self) -> None:
        """On a thread of the server's: the page goes on meanwhile."""
        try:
            number = self._one()
            self._say(f"looking for a better pose of LiDAR {number} …")
            found = self.studio.improve(number)
            better = f"expected recall {found.before:.4f} → {found.after:.4f}"
            same = "no better pose was found"
            self._say(better if found.after > found.before else same)
        except ValueError as error:
            self._say(str(error), good=False)
        self.refresh()

    def _write(self, write: Callable[[bool], str]) -> None:
        try:
            self._say(write(False))
        except FileExistsError as error:
            self._overwrite = lambda: write(True)
            self.panel.overwrite.visible = True
            self._say(str(error), good=False)

    def _confirm(self) -> None:
        if self._overwrite is not None:
            self._say(self._overwrite())
            self._overwrite = None

    def _beside(self, name: str) -> Path:
        """A file in the folder of the rigs: a page may write nowhere else."""
        if not name or Path(name).name != name or not name.endswith((".yaml", ".yml")):
            raise ValueError(f"the name of a file ends in .yaml and has no folder, found {name!r}")
        return self.studio.file.path.parent / name

    def _save(self, overwrite: bool) -> str:
        return f"saved: {self.studio.save(self._beside(self.panel.path.value), overwrite)}"

    def _sweep(self, overwrite: bool) -> str:
        if self._log is None:
            raise ValueError("a sweep needs a log on disk: start the studio with --log FOLDER")
        path = self._beside(self.panel.sweep_path.value)
        return self.studio.sweep(path, self._log.absolute(), overwrite)

    def _say(self, text: str, good: bool = True) -> None:
        self.panel.message.content = message(text, good) if text else ""

    def _play(self) -> None:
        while not self._closed.wait(PLAY_S):
            if self.panel.play.value:
                number = (self.panel.frame.value + 1) % len(self.studio.frame_numbers)
                assign(self.panel.frame, number)
                self.studio.show_frame(self.studio.frame_numbers[number])
                self.refresh(resting=False)

    # What is drawn for it.

    def _draw(self, resting: bool) -> None:
        studio, panel = self.studio, self.panel
        rig = studio.rig
        if self.chosen is not None and self.chosen >= len(rig.lidars):
            self.chosen = len(rig.lidars) - 1 if rig.lidars else None
        ground = self._ground()
        self._draw_numbers(resting, ground)
        self._server.flush()
        self._draw_lidars(resting)
        view, placement = studio.view, studio.placement
        working = [n for n, lidar in enumerate(rig.lidars) if lidar.enabled]
        most = RESTING_POINTS if resting else MOVING_POINTS
        cloud = view.cloud(placement, most) if panel.cloud.value else None
        with self._server.atomic():
            self._scene.cloud(cloud, working)
        self._server.flush()
        objects = view.objects(placement)
        self._scene.objects(view.frame.objects, objects)
        panel.unseen.content = unseen_list(objects)
        self._scene.blind(ground)
        if resting:
            panel.violations.content = violations_list(studio.violations())
            panel.show(studio, self.chosen)
            panel.show_objects(view.frame.objects["object_id"].astype(str).tolist())
            self._draw_answer()
        self._server.flush()

    def _ground(self) -> BlindGround | None:
        """What is blind, if somebody wants to see it."""
        who = self.panel.blind.value
        return None if who == NOBODY else self.studio.blind_ground(HEIGHTS_M[who])

    def _draw_numbers(self, resting: bool, ground: BlindGround | None) -> None:
        studio = self.studio
        others: list[Row] = []
        if studio.file.settings.prices:
            begun = studio.price_begun
            others.append(("Price", studio.price, begun, ",.6g"))
        if ground is not None:
            label = f"Blind for {self.panel.blind.value}, %"
            others.append((label, 100 * ground.share, None, ".1f"))
        self.panel.numbers.content = numbers_table(
            studio.numbers(resting), studio.numbers_begun(resting), studio.meter.h_pog, others
        )

    def _draw_lidars(self, resting: bool) -> None:
        """While one is dragged its own solid alone moves: the rest is as it was."""
        rig = self.studio.rig
        if not resting and self.chosen is not None:
            self._scene.move(self.chosen, rig.mounts[self.chosen])
            return
        drawn = (rig, self.chosen)
        if drawn == self._drawn:
            return
        self._drawn = drawn
        with self._server.atomic():
            self._scene.lidars(rig, rig.models(self.studio.lidar), self.chosen)
            self._draw_handle()

    def _draw_handle(self) -> None:
        """The handle of the chosen LiDAR; it is one for all of them."""
        if self.chosen is None:
            if self._handle is not None:
                self._handle.visible = False
            return
        mount = self.studio.rig.mounts[self.chosen]
        if self._handle is None:
            self._handle = self._server.scene.add_transform_controls(
                "/handle", scale=1.0, line_width=3.0, depth_test=False
            )
            self._handle.on_update(self._dragged)
        self._handle.position = mount.position
        self._handle.wxyz = quaternion(mount)
        self._handle.visible = True

    def _draw_answer(self) -> None:
        chosen = self.panel.object.value
        if chosen == NO_OBJECT or self.studio.placement is None:
            self.panel.answer.content = ""
            return
        rays = self.studio.why_unseen(chosen)
        objects = self.studio.view.objects(self.studio.placement)
        self.panel.answer.content = object_answer(objects, chosen, rays)
