"""What in a store can go: what no sweep refers to, and what killed processes left behind."""

from collections.abc import Mapping
from dataclasses import dataclass

from sweeps.store.entries import Entry, size_of
from sweeps.store.open import AnyStore


@dataclass(frozen=True)
class Cleaned:
    """What lay in a store, and what became of it.

    Attributes:
        contents: all that lay there.
        references: keys by name of the sweep that refers to them.
        leftovers: what killed processes left and nobody can use.
        removed: results, least recently used first, and all leftovers; with `dry_run` what would
            be removed.
    """

    contents: tuple[Entry, ...]
    references: Mapping[str, set[str]]
    leftovers: tuple[Entry, ...]
    removed: tuple[Entry, ...]

    @property
    def kept_bytes(self) -> int:
        """Bytes that are left."""
        return size_of(self.contents) - size_of(self.removed)

    @property
    def referred(self) -> set[str]:
        """Keys that some sweep refers to."""
        return set[str]().union(*self.references.values())


def clean_store(store: AnyStore, quota_bytes: int | None = None, dry_run: bool = False) -> Cleaned:
    """Remove leftovers and results that no sweep refers to.

    The caller holds `store.exclusive()`, except for a dry run.

    Args:
        quota_bytes: keep results, most recently used first, as long as all of the store is no
            larger; None: remove all that no sweep refers to.
        dry_run: remove nothing.

    Raises:
        ValueError: the file of a sweep is damaged, so what it refers to is not known.
    """
    references = store.references()
    contents = store.contents()
    referred = set[str]().union(*references.values())
    results = [entry for entry in contents if entry.kind == "result"]
    there = {entry.key for entry in results}
    leftovers = [
        entry
        for entry in contents
        if entry.kind in ("partial", "running")
        or (entry.kind == "working" and (entry.key in there or entry.key not in referred))
    ]
    unused = [entry for entry in results if entry.key not in referred]
    doomed = unused
    if quota_bytes is not None:
        excess = size_of(contents) - size_of(leftovers) - quota_bytes
        doomed = []
        for entry in sorted(unused, key=store.last_used) if excess > 0 else ():
            if excess > 0:
                doomed.append(entry)
                excess -= entry.size
    removed = (*leftovers, *doomed)
    for entry in () if dry_run else removed:
        store.remove(entry)
    return Cleaned(tuple(contents), references, tuple(leftovers), removed)
