"""What was done and can be undone: values, one after the other."""

from typing import Generic, TypeVar

T = TypeVar("T")


class History(Generic[T]):
    """A value that changes, and what it was.

    While something is dragged its value changes all the time; `try_out` shows it, and `keep`
    makes one step of all of it.
    """

    def __init__(self, value: T) -> None:
        self._past: list[T] = []
        self._kept = value
        self._future: list[T] = []
        self.value = value

    def do(self, value: T) -> None:
        """Change the value, as one step."""
        self.keep()
        self.try_out(value)
        self.keep()

    def try_out(self, value: T) -> None:
        """Change the value, as part of a step that goes on."""
        self.value = value

    def keep(self) -> None:
        """End the step that is under way, if the value has changed."""
        if self.value != self._kept:
            self._past.append(self._kept)
            self._future.clear()
            self._kept = self.value

    def undo(self) -> bool:
        """Go one step back; whether there is one."""
        self.keep()
        if not self._past:
            return False
        self._future.append(self._kept)
        self._kept = self.value = self._past.pop()
        return True

    def redo(self) -> bool:
        """Go one step forward again; whether there is one."""
        self.keep()
        if not self._future:
            return False
        self._past.append(self._kept)
        self._kept = self.value = self._future.pop()
        return True
