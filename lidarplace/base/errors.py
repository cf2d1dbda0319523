"""The error of a user's mistake: its parts as attributes, its line from them."""


class InputError(ValueError):
    """A mistake in what was given, one line: `PLACE: KEY: PROBLEM; expected X, found Y; FIX`.

    Attributes:
        problem: what is wrong, the whole line where no part of it is known.
        place: file, option or row that holds it. None where unknown, as all that follow.
        key: column, or path in nested settings.
        expected, found: what is allowed there, and what is there.
        fix: what to do.
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
