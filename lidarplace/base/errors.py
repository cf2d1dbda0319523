"""The error of a user's mistake: its parts as attributes, its line from them."""


class InputError(ValueError):
    """A mistake in what was given, one line: `PLACE: KEY: PROBLEM; expected X, found Y; FIX`.

    `place` is a file, an option or a row, `key` a column, or a path in nested settings, `fix` what
    to do. What is unknown is None; `problem` is the whole line if all of it is.
    """

    def __init__(
        self,
        problem: str,
        *,
        place: str | None = None,
        key: str | None = None,
        expected: str | None = None,
        found: str | None = None,
        fix: str | None = None,
    ) -> None:
        self.problem, self.place, self.key = problem, place, key
        self.expected, self.found, self.fix = expected, found, fix
        both = [f"{word} {one}" for word, one in (("expected", expected), ("found", found)) if one]
        where = ": ".join(part for part in (place, key, problem) if part)
        super().__init__("; ".join(part for part in (where, ", ".join(both), fix) if part))
