"""When a page is drawn: at once and coarsely while something moves, fully when it rests."""

import threading
from collections.abc import Callable

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
