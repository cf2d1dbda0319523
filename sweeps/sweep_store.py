"""The store that a configuration names."""

from __future__ import annotations

from sweeps.grid import Sweep
from sweeps.remote_store import open_store
from sweeps.store import AnyStore


def store_of(sweep: Sweep) -> AnyStore:
    """The store of a sweep. Raises ValueError if its URL is of no known kind."""
    settings = sweep.common.store
    return open_store(settings.url, sweep.common.output, settings.cache)
