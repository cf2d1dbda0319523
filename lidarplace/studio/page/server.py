"""The server of a page: on this machine alone, and without a way out of it."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from typing import TYPE_CHECKING

from lidarplace.command_line.port import free_port

if TYPE_CHECKING:
    import viser

HOST = "127.0.0.1"
FIRST_PORT = 8080


@contextmanager
def serving(port: int | None, title: str) -> Iterator[viser.ViserServer]:
    """A server that listens while the block runs.

    Args:
        port: None for FIRST_PORT or the next one that is free.
        title: of the panel.

    Raises:
        ValueError: the port is taken.
    """
    import viser

    class Local(viser.ViserServer):
        """Any page can ask for a public address of the server; it gets none."""

        def request_share_url(self, verbose: bool = True) -> str | None:
            return None

    with redirect_stdout(io.StringIO()):  # viser's banner
        server = Local(HOST, free_port(port, FIRST_PORT, HOST), title, verbose=False)
    try:
        server.gui.configure_theme(show_logo=False, show_share_button=False, control_width="medium")
        server.gui.main_panel.dock_right()
        yield server
    finally:
        with redirect_stdout(io.StringIO()):
            server.stop()
