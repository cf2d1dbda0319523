"""A mistake by the parts of its error, so that the words of the line may change."""

import re
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from lidarplace.base.errors import InputError


@contextmanager
def refused(expected: str | tuple[str, str, str], source: str = "") -> Iterator[None]:
    """Expect that the block is refused: a pattern of the line, or place, key and what was found.

    Place and what was found may be parts of the error's; "" fits all. The line names `source`.
    """
    with pytest.raises(ValueError) as caught:  # noqa: PT011 - compared below
        yield
    error = caught.value
    assert source in str(error)
    if isinstance(expected, str):
        assert re.search(expected, str(error))
        return
    place, key, found = expected
    assert isinstance(error, InputError)
    assert place in str(error.place)
    assert error.key == key
    assert found in str(error.found or "")
