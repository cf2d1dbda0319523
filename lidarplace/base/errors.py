"""The error of a user's mistake: its parts as attributes, its line from them."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import PurePath


class InputError(ValueError):
    """A mistake in the input, one line: `PLACE: KEY: PROBLEM; expected X, found Y; FIX`.

    `place` is a file, an option or a row, `key` a column, or a path in nested settings, `fix` what
    to do. All are strings, empty where unknown."""

    def __init__(
        self,
        problem: str = "",
        *,
        place: str | PurePath = "",
        key: str = "",
        expected: object = "",
        found: object = "",
        fix: str = "",
    ) -> None:
        self.problem, self.place, self.key, self.fix = problem, str(place), key, fix
        self.expected, self.found = str(expected), str(found)
        pair = (("expected", self.expected), ("found", self.found))
        both = ", ".join(f"{word} {text}" for word, text in pair if text)
        text = "; ".join(part for part in (problem, both, fix) if part)
        super().__init__(": ".join(part for part in (self.place, key, text) if part))


@contextmanager
def at(
    place: str | PurePath = "", error: type[InputError] = InputError, key: str = ""
) -> Iterator[None]:
    """Put `place` and `key` in front of a ValueError of the block, which becomes an `error`.

    Parts stay. A place that is already in front is not repeated; one that follows a key is in the
    problem."""
    try:
        yield
    except ValueError as wrong:
        cause = wrong if isinstance(wrong, InputError) else InputError(" ".join(str(wrong).split()))
        if key and cause.place:
            cause = InputError(str(cause))
        front = "" if f"{cause.place}: ".startswith(f"{place}: ") else str(place)
        paths = {"place": (front, cause.place), "key": (key, cause.key)}
        joined = {name: ": ".join(filter(None, parts)) for name, parts in paths.items()}
        raise error(**vars(cause) | joined) from None
