"""What `sweeps.clean` tells of a store: tables, or the same for a script."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from rich.console import Console
from rich.filesize import decimal
from rich.table import Table

from sweeps.store.cleaning import Cleaned, size_of
from sweeps.store.entries import Entry


def print_cleaned(console: Console, cleaned: Cleaned, dry_run: bool, limit: int | None) -> None:
    """Print sizes by stage and by sweep, and what was removed."""
    _print_stages(console, cleaned)
    _print_sweeps(console, cleaned)
    done = "would be removed" if dry_run else "removed"
    console.print(
        f"{done}: {_told(cleaned.removed)}; left: {decimal(cleaned.kept_bytes)}", highlight=False
    )
    if limit is not None and cleaned.kept_bytes > limit:
        console.print(
            f"what sweeps refer to is larger than {decimal(limit)}; name those that are needed no "
            "more with --forget",
            soft_wrap=True,
        )


def summary_of(cleaned: Cleaned, dry_run: bool) -> dict[str, Any]:
    """The same for a script, sizes in bytes."""
    results = [entry for entry in cleaned.contents if entry.kind == "result"]
    by_stage = {
        stage: [entry for entry in results if entry.stage == stage]
        for stage in dict.fromkeys(entry.stage for entry in results)
    }
    return {
        "dry_run": dry_run,
        "stages": {
            stage: {
                "all": _sizes(here),
                "of_no_sweep": _sizes(_not_in(here, cleaned.referred)),
            }
            for stage, here in by_stage.items()
        },
        "sweeps": {
            name: {"refers_to": len(keys), **_sizes([e for e in results if e.key in keys])}
            for name, keys in cleaned.references.items()
        },
        "leftovers": _sizes(cleaned.leftovers),
        "removed": _sizes(cleaned.removed),
        "left_bytes": cleaned.kept_bytes,
    }


def _sizes(entries: Collection[Entry]) -> dict[str, int]:
    return {"count": len(entries), "bytes": size_of(entries)}


def _print_stages(console: Console, cleaned: Cleaned) -> None:
    referred = cleaned.referred
    results = [entry for entry in cleaned.contents if entry.kind == "result"]
    table = _table("stage", "results", "size", "of no sweep", "size of these")
    for stage in dict.fromkeys(entry.stage for entry in results):
        here = [entry for entry in results if entry.stage == stage]
        table.add_row(stage, *_counted(here), *_counted(_not_in(here, referred)))
    table.add_row("all", *_counted(results), *_counted(_not_in(results, referred)), style="bold")
    console.print(table)
    usable = [e for e in cleaned.contents if e.kind == "working" and e not in cleaned.leftovers]
    console.print(f"checkpoints of unfinished trainings: {_told(usable)}", highlight=False)
    console.print(f"leftovers of killed processes: {_told(cleaned.leftovers)}", highlight=False)


def _print_sweeps(console: Console, cleaned: Cleaned) -> None:
    table = _table("sweep", "refers to", "of these there", "size")
    for name, keys in cleaned.references.items():
        there = [e for e in cleaned.contents if e.kind == "result" and e.key in keys]
        table.add_row(name, str(len(keys)), *_counted(there))
    console.print(table)


def _table(first: str, *columns: str) -> Table:
    table = Table(first)
    for column in columns:
        table.add_column(column, justify="right")
    return table


def _not_in(entries: Collection[Entry], keys: set[str]) -> list[Entry]:
    return [entry for entry in entries if entry.key not in keys]


def _counted(entries: Collection[Entry]) -> tuple[str, str]:
    return str(len(entries)), decimal(size_of(entries))


def _told(entries: Collection[Entry]) -> str:
    return f"{len(entries)} ({decimal(size_of(entries))})"
