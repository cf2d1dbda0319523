"""Delivers entries in order from a thread, however often the receiver goes away."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from threading import Condition, Thread
from typing import Generic, TypeVar

T = TypeVar("T")

FIRST_PAUSE_S = 0.2
LONGEST_PAUSE_S = 10.0


class Away(Exception):
    """The receiver cannot be reached now; what was sent may or may not have arrived."""


class Delivery(Generic[T]):
    """Sends what it was given, one after the other.

    Args:
        send: takes one entry. Raises Away, and gets the same entry again after a pause; any other
            exception means that this entry will never be taken.
        refuse: told of such an entry, and why.
        away: told once why the receiver is away.
        back: told once when it is back.
    """

    def __init__(
        self,
        send: Callable[[T], None],
        refuse: Callable[[T, Exception], None],
        away: Callable[[Away], None],
        back: Callable[[], None],
    ) -> None:
        self._send = send
        self._refuse = refuse
        self._tell_away = away
        self._tell_back = back
        self._waiting: deque[T] = deque()
        self._changed = Condition()
        self._ending = False
        self._stopped = False
        self._is_away = False
        self._thread = Thread(target=self._deliver, name="delivery", daemon=True)

    def __len__(self) -> int:
        """Entries that have not been delivered or refused."""
        return len(self._waiting)

    def start(self, reason: Away | None = None) -> None:
        """Begin to send. `reason`: the receiver was found away already."""
        if reason is not None:
            self._went_away(reason)
        self._thread.start()

    def put(self, entry: T) -> None:
        """Send an entry after those put before. Returns at once."""
        with self._changed:
            self._waiting.append(entry)
            self._changed.notify_all()

    def finish(self, patience_s: float) -> None:
        """Wait until all is delivered, or until nothing was for `patience_s`; then stop."""
        with self._changed:
            self._ending = True
            self._changed.notify_all()
            while self._waiting and self._changed.wait(patience_s):
                pass
            self._stopped = True
            self._changed.notify_all()
        if not self._waiting:
            self._thread.join()

    def _deliver(self) -> None:
        pause = FIRST_PAUSE_S
        while (entry := self._next()) is not None:
            try:
                self._send(entry)
            except Away as reason:
                self._went_away(reason)
                self._rest(pause)
                pause = min(2 * pause, LONGEST_PAUSE_S)
                continue
            except Exception as error:
                self._refuse(entry, error)
            pause = FIRST_PAUSE_S
            if self._is_away:
                self._is_away = False
                self._tell_back()
            with self._changed:
                self._waiting.popleft()
                self._changed.notify_all()

    def _next(self) -> T | None:
        """The next entry, as soon as there is one; None at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._ending or self._stopped)
            return None if self._stopped or not self._waiting else self._waiting[0]

    def _went_away(self, reason: Away) -> None:
        if not self._is_away:
            self._is_away = True
            self._tell_away(reason)

    def _rest(self, seconds: float) -> None:
        with self._changed:
            self._changed.wait_for(lambda: self._stopped, seconds)
