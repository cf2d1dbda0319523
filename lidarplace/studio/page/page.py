"""A studio in the browser: what a person does on the page reaches the state, and is drawn.

Edits come from the server's event loop and change the state alone; a thread draws it (`Redraw`).
What takes longer runs on threads of the server's, or in processes. Browsers see the same rigs."""

from __future__ import annotations

import io
import threading
from collections.abc import Callable, Coroutine, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from lidarplace.studio.page.drawing import Drawing, Redraw
from lidarplace.studio.page.editing import Editing, model_named
from lidarplace.studio.page.jobs import Files, Jobs
from lidarplace.studio.page.panel import NO_RIG, Panel, assign
from lidarplace.studio.page.tables import message
from lidarplace.studio.studio import Studio

if TYPE_CHECKING:
    import viser

PLAY_S = 0.2
"""Time between two frames that are played, seconds."""

_Event = Callable[[Any], Coroutine[Any, Any, None]]


class Page:
    """A studio on a server of `lidarplace.studio.page.server.serving`, until `close`.

    Edits from elsewhere are drawn after `refresh`. `scene` is the traffic of sweeps of the rigs."""

    def __init__(self, studio: Studio, server: viser.ViserServer, scene: Mapping[str, Any]) -> None:
        self.studio, self._server = studio, server
        studio.prepare()  # takes seconds, before anybody waits for it
        self.panel = Panel(server, studio)
        self.editing = Editing(studio, self.panel)
        self.files = Files(studio, self.panel, scene)
        self.jobs = Jobs(studio, self.panel, self.editing, self.files, self._say)
        self._drawing = Drawing(studio, server, self.panel, self.editing, self._pulled)
        self._closed = threading.Event()
        self._redraw = Redraw(self._drawing.draw, lambda error: self._say(str(error), False))
        self._listen()
        self._player = threading.Thread(target=self._play, daemon=True, name="play")
        self._player.start()
        self.refresh()

    def close(self) -> None:
        """Draw no more, and end what runs for the page."""
        self._closed.set()
        self._player.join()
        self.jobs.close()
        self._redraw.end()

    def refresh(self, resting: bool = True) -> None:
        """Draw what the studio has become."""
        self._redraw.ask(resting)

    def _listen(self) -> None:
        panel, editing, studio, one = self.panel, self.editing, self.studio, self.editing.one
        for name, field in panel.pose.items():
            field.on_update(self._edit(partial(editing.typed, name)))
        panel.rig.on_update(self._edit(editing.choose_rig))
        panel.lidar.on_update(self._edit(editing.choose_lidar))
        panel.history.on_click(self._edit(lambda value: getattr(studio, value)()))
        panel.model.on_update(self._edit(lambda name: studio.model(one(), model_named(name))))
        panel.works.on_update(self._edit(lambda works: studio.enable(one(), works)))
        panel.change.on_click(self._edit(editing.change))
        panel.frame.on_update(self._edit(lambda n: studio.show_frame(studio.frame_numbers[n])))
        for control in (panel.cloud, panel.ground, panel.object, panel.other_rig, panel.apart):
            control.on_update(self._edit(lambda _: None))
        for moved in (panel.other_rig, panel.apart):
            moved.on_update(self._turn)
        panel.copy.on_click(self._edit(lambda _: studio.copy_rig(panel.new_rig.value)))
        panel.save.on_click(self._edit(lambda _: self._say(self.files.save())))
        panel.sweep.on_click(self._edit(lambda _: self._say(self.files.sweep())))
        panel.overwrite.on_click(self._edit(lambda _: self._say(self.files.confirm())))
        panel.cancel.on_click(self._edit(lambda _: self.jobs.cancel()))
        panel.improve.on_click(self._ask(lambda _: self.jobs.improve()))
        panel.add_best.on_click(self._ask(lambda _: self.jobs.add_best()))
        panel.evaluate.on_click(self._ask(lambda _: self.jobs.evaluate()))
        panel.compare.on_click(self._ask(lambda _: self.jobs.compare()))
        panel.picture.on_click(self._ask(lambda event: send_picture(event.client)))

    def _edit(self, act: Callable[[Any], object]) -> _Event:
        """Return an event that changes the studio; the page shows a mistake."""

        async def done(event: Any) -> None:
            if event.client is None:  # the panel was brought up to date by us
                return
            self._say("")
            self.panel.overwrite.visible = False
            self._try(act, event.target.value)

        return done

    def _ask(self, act: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return an event that takes long, on a thread of the server's; the page goes on."""
        return lambda event: self._try(act, event)

    def _try(self, act: Callable[[Any], object], argument: Any) -> None:
        try:
            act(argument)
        except (ValueError, OSError) as error:
            self._say(str(error), False)
        self.refresh()

    async def _turn(self, event: Any) -> None:
        """Turn the camera of the browser in which two rigs come apart, or together again."""
        panel = self.panel
        other = panel.other_rig if event.target is panel.apart else panel.apart
        if event.client is not None and other.value not in (NO_RIG, False):
            self._drawing.other_rig.turn_camera(event.client)

    async def _pulled(self, event: viser.TransformControlsEvent) -> None:
        goes_on = True
        try:
            goes_on = self.editing.pulled(event)
        except ValueError as error:  # such as below the ground
            self._say(str(error), False)
        self.refresh(resting=not goes_on)

    def _say(self, text: str, good: bool = True) -> None:
        self.panel.message.content = message(text, good) if text else ""

    def _play(self) -> None:
        while not self._closed.wait(PLAY_S):
            if self.panel.play.value:
                number = (self.panel.frame.value + 1) % len(self.studio.frame_numbers)
                assign(self.panel.frame, number)
                self.studio.show_frame(self.studio.frame_numbers[number])
                self.refresh(resting=False)


PATIENCE_S = 120.0
"""Time to wait for a picture, seconds: a browser without a GPU draws slowly."""


def send_picture(client: viser.ClientHandle) -> None:
    """Let a browser save its scene as a PNG file. Raises ValueError: it does not answer."""
    import imageio.v3 as iio

    try:
        size = client.camera.image_height, client.camera.image_width
        image = client.get_render(*size, transport_format="png", timeout=PATIENCE_S)
    except (TimeoutError, RuntimeError) as error:
        raise ValueError(f"the browser sent no picture: {error}") from None
    pixels = image.astype(np.float64)
    opacity = pixels[..., 3:] / 255
    on_white = (opacity * pixels[..., :3] + (1 - opacity) * 255).round().astype(np.uint8)
    file = io.BytesIO()
    iio.imwrite(file, on_white, extension=".png")
    client.send_file_download("studio.png", file.getvalue(), save_immediately=True)
