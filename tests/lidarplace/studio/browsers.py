"""A client of viser's server in place of a browser, of which many run at a time."""

import shutil
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import msgspec.msgpack
import pytest
import viser
import zstandard
from viser import _messages
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

from lidarplace.studio.page.page import Page
from lidarplace.studio.page.server import serving
from lidarplace.studio.studio import Studio

GUARD_S = 300
"""Time limit against hanging, seconds."""


def chromium_program() -> str:
    """Return the path of chromium; the test is skipped without it."""
    return shutil.which("chromium") or pytest.skip("needs chromium")


@contextmanager
def chromium(*options: str) -> Iterator[tuple[Any, Any]]:
    """A real browser, and playwright's `expect`; the test is skipped without them."""
    playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright")
    program = chromium_program()
    with playwright.sync_playwright() as browsers:
        arguments = ["--no-sandbox", *options]
        browser = browsers.chromium.launch(executable_path=program, args=arguments)
        yield browser, playwright.expect
        browser.close()


@contextmanager
def shown(studio: Studio) -> Iterator[Page]:
    """The page of a studio, which has its `address`."""
    with serving(None, "studio") as (server, address):
        page = Page(studio, server, {"source": "log", "folder": "logs/mine"})
        page.address = address
        yield page
        page.close()


def until(happened: Callable[[], object]) -> None:
    """Wait for what another thread will do."""
    end = time.monotonic() + GUARD_S
    while not happened():
        assert time.monotonic() < end
        time.sleep(0.01)


class Browser:
    """A connection to a page; a thread of its own reads what comes.

    Attributes:
        content: HTML by the id of its field, as it was told last.
        values: of the fields in which something is typed or chosen, by label.
        texts: of the labels in the scene, by their name.
        cameras: where the camera was put by the server.
    """

    def __init__(self, address: str) -> None:
        protocol = f"viser-v{viser.__version__}"
        self._socket = connect(
            address.replace("http", "ws"),
            origin=Origin(address.rpartition("/")[0]),
            subprotocols=[Subprotocol(protocol)],
            max_size=None,
        )
        self.content: dict[str, str] = {}
        self.values: dict[str, Any] = {}
        self.texts: dict[str, str] = {}
        self.cameras: list[tuple[float, float, float]] = []
        self._label: dict[str, str] = {}
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        camera = _messages.ViewerCameraMessage(
            (1.0, 0.0, 0.0, 0.0), (-6.0, 4.0, 5.0), 1.0, 0.1, 100.0, 480, 640,
            (1.5, 0.0, 0.8), (0.0, 0.0, 1.0),
        )  # fmt: skip
        self._say(camera)

    @property
    def labels(self) -> set[str]:
        """Labels of the fields and buttons."""
        return set(self._label.values())

    def type(self, label: str, value: object) -> None:
        """Type into the field of that label, choose in it, or press it."""
        uuid = next(uuid for uuid, text in self._label.items() if text == label)
        self._say(_messages.GuiUpdateMessage(uuid, {"value": value}))

    def pull(self, position: tuple[float, float, float]) -> None:
        """Pull at the handle, and hold it."""
        self._say(_messages.TransformControlsDragStartMessage("/handle"))
        turn = (1.0, 0.0, 0.0, 0.0)
        self._say(_messages.TransformControlsUpdateMessage("/handle", turn, position))

    def close(self) -> None:
        """Close the tab."""
        self._socket.close()
        self._reader.join()

    def _say(self, message: _messages.Message) -> None:
        self._socket.send(msgspec.msgpack.encode(message.as_serializable_dict()))

    def _read(self) -> None:
        try:
            for raw in self._socket:
                assert isinstance(raw, bytes)
                end = 16 + int.from_bytes(raw[8:16], "little")
                inner = zstandard.ZstdDecompressor().decompress(raw[16:end])
                for message in msgspec.msgpack.decode(inner)["messages"]:
                    self._hear(message)
        except ConnectionClosed:
            pass

    def _hear(self, message: dict[str, Any]) -> None:
        uuid = message.get("uuid", "")
        properties = message.get("props", {}) | message.get("updates", {})
        if "text" in properties:
            self.texts[message["name"]] = properties["text"]
        if message["type"] == "SetCameraPositionMessage":
            self.cameras.append(tuple(message["position"]))
        if "label" in properties:
            self._label[uuid] = properties["label"]
        if "content" in properties:
            self.content[uuid] = properties["content"]
        for source in (message, properties):
            if "value" in source and uuid in self._label:
                self.values[self._label[uuid]] = source["value"]
