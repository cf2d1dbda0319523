"""A free port of this machine for a server on the loopback interface."""

import socket

from lidarplace.base.errors import InputError

TRIED = 100
"""Number of ports in a row to try."""


def free_port(requested: int | None, first: int, host: str = "127.0.0.1") -> int:
    """Return the requested port, or the first free one from `first`. Raises ValueError: taken."""
    for port in range(first, first + TRIED) if requested is None else (requested,):
        with socket.socket() as listener:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                listener.bind((host, port))
            except OSError as error:
                if requested is not None:
                    raise InputError(str(error.strerror), place=f"--port {port}") from None
            else:
                return port
    taken = f"ports {first} to {first + TRIED - 1} are taken"
    raise InputError(taken, fix="name one with --port")
