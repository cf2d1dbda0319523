"""What in a store can go: what no sweep refers to, and what killed processes left behind."""

from collections.abc import Mapping
from dataclasses import dataclass

from sweeps.store.entries import Entry, size_of
from sweeps.store.local import Store


@dataclass(frozen=True)
class Cleaned:
    """What lay in a store, keys by name of the sweep that refers to them, what killed processes
    left and nobody can use, and what was or would be removed: these, and results, least recently
    used first."""

    contents: tuple[Entry, ...]
    references: Mapping[str, set[str]]
    leftovers: tuple[Entry, ...]
    removed: tuple[Entry, ...]

    @property
    def kept_bytes(self) -> int:
        return size_of(self.contents) - size_of(self.removed)

    @property
    def referred(self) -> set[str]:
        return set[str]().union(*self.references.values())


def clean_store(store: Store, quota_bytes: int | None = None, dry_run: bool = False) -> Cleaned:
    """Remove leftovers, and results that no sweep refers to: all, or with a quota those least
    recently used, until the store is no larger. The caller holds `store.exclusive()`, except for a
    dry run. Raises ValueError: the file of a sweep is damaged, so what it refers to is not
    known."""
    references, contents = store.references(), store.contents()
    referred = set[str]().union(*references.values())
    results = [entry for entry in contents if entry.kind == "result"]
    usable = referred - {entry.key for entry in results}  # checkpoints
    leftovers = [
        entry
        for entry in contents
        if entry.kind in ("partial", "running")
        or (entry.kind == "working" and entry.key not in usable)
    ]
    doomed = [entry for entry in results if entry.key not in referred]
    if quota_bytes is not None:
        excess = size_of(contents) - size_of(leftovers) - quota_bytes
        oldest = iter(sorted(doomed, key=store.last_used) if excess > 0 else ())
        doomed = []
        while excess > 0 and (entry := next(oldest, None)):
            doomed.append(entry)
            excess -= entry.size
    removed = (*leftovers, *doomed)
    for entry in () if dry_run else removed:
        store.remove(entry)
    return Cleaned(tuple(contents), references, tuple(leftovers), removed)
