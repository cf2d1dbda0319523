"""Cleaning of a store: results that no sweep refers to, and files of killed processes."""

from collections.abc import Mapping
from dataclasses import dataclass

from sweeps.store.entries import Entry, size_of
from sweeps.store.local import Store


@dataclass(frozen=True)
class Cleaned:
    """A store before its cleaning, and what was or would be removed.

    `contents`: all entries. `references`: keys by name of the sweep that refers to them.
    `leftovers`: files of killed processes that nobody can use. `removed`: leftovers and results,
    least recently used first."""

    contents: tuple[Entry, ...]
    references: Mapping[str, set[str]]
    leftovers: tuple[Entry, ...]
    removed: tuple[Entry, ...]

    @property
    def kept_bytes(self) -> int:
        """Bytes of the entries that stay."""
        return size_of(self.contents) - size_of(self.removed)

    @property
    def referred(self) -> set[str]:
        """Keys that any sweep refers to."""
        return set[str]().union(*self.references.values())


def clean_store(store: Store, quota_bytes: int | None = None, dry_run: bool = False) -> Cleaned:
    """Remove leftovers, and results that no sweep refers to.

    All of these results, or with a quota those least recently used, until the store is no larger.
    The caller holds `store.exclusive()`, except for a dry run. Raises InputError: the file of a
    sweep is damaged, so its references are unknown."""
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
