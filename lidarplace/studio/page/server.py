"""Server of a page: on this machine alone, for pages of its own address, and without a way out.

viser has no hook to reject a request, so the listening call that it makes is replaced at start."""

from __future__ import annotations

import io
import re
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import replace
from functools import partial
from http import HTTPStatus
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

from lidarplace.base.errors import InputError
from lidarplace.command_line.port import free_port

if TYPE_CHECKING:
    import viser
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

HOST = "127.0.0.1"
FIRST_PORT = 8080
NAMES = re.compile(r"(127\.0\.0\.1|localhost)(:\d+)?")
"""Names of this machine in a browser on it, with any port that is forwarded to the server's."""

_Answer = Callable[["ServerConnection", "Request"], "Response | None"]


@contextmanager
def serving(port: int | None, title: str) -> Iterator[tuple[viser.ViserServer, str]]:
    """Start a server that listens while the block runs; yield it and its address, a secret.

    None is FIRST_PORT or the next free one. Raises ValueError: the port is taken, or requests to
    this version of viser cannot be checked."""
    import viser
    from websockets.asyncio import server as websockets_server

    class Local(viser.ViserServer):
        """A server without a public address, which any page could request."""

        def request_share_url(self, verbose: bool = True) -> str | None:
            """Return no address."""
            return None

    token, listen = secrets.token_urlsafe(), websockets_server.serve

    def guarded(*arguments: Any, process_request: Any = None, **options: Any) -> Any:
        check = partial(_answer, token, process_request)
        return listen(*arguments, process_request=check, **options)

    with (
        redirect_stdout(io.StringIO()),  # viser's banner
        patch.object(websockets_server, "serve", side_effect=guarded) as called,
    ):
        server = Local(HOST, free_port(port, FIRST_PORT, HOST), title, verbose=False)
    try:
        if not called.called:
            problem, fix = "does not let its requests be checked", "pip install 'viser==1.1.*'"
            raise InputError(problem, place=f"viser {viser.__version__}", expected="1.1", fix=fix)
        server.gui.configure_theme(show_logo=False, show_share_button=False, control_width="medium")
        server.gui.main_panel.dock_right()
        yield server, f"http://{server.get_host()}:{server.get_port()}/{token}"
    finally:
        with redirect_stdout(io.StringIO()):
            server.stop()


def _answer(
    token: str, viser_answer: _Answer, connection: ServerConnection, request: Request
) -> Response | None:
    """Return what viser answers to a request with the token and, to connect, the page's own origin.

    A page from elsewhere does not know the token, and one whose name was bound to this machine
    (DNS rebinding) says that name as its host. viser's page connects to the path that it is at."""
    host, origin = (",".join(request.headers.get_all(name)) for name in ("Host", "Origin"))
    path = request.path.partition("?")[0].strip("/").encode(errors="replace")
    if NAMES.fullmatch(host) and secrets.compare_digest(path, token.encode()):
        answer = viser_answer(connection, replace(request, path="/"))
        if answer is not None or origin == f"http://{host}":
            return answer
    return connection.respond(HTTPStatus.FORBIDDEN, "open the whole address of the studio\n")
