"""Work goes on when it meets a damaged result: it begins again, and what is gone is computed."""

from collections import Counter
from collections.abc import Callable
from typing import TypeVar

from lidarplace.files.secret_urls import hide_secrets
from sweeps.store.result_folder import DamagedResult

T = TypeVar("T")

_PATIENCE = 3  # a disk that spoils the same result every time is not worth more


def until_whole(work: Callable[[], T], say: Callable[[str], object]) -> T:
    """What `work` returns, which begins again after a `DamagedResult`, as a resumed command does.

    A store removes what it finds damaged, so `work` does not meet it twice.

    Args:
        say: takes the line that names the result.

    Raises:
        DamagedResult: the same result is damaged again and again.
    """
    met = Counter[str]()
    while True:
        try:
            return work()
        except DamagedResult as error:
            met[str(error)] += 1
            if met[str(error)] == _PATIENCE:
                raise
            say(hide_secrets(str(error)))
