"""Sizes of a store, and removal of unused results: `lidarplace clean grid.yaml`."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.filesize import decimal

from lidarplace.base.errors import InputError
from lidarplace.command_line.terminal import output, table
from lidarplace.command_line.verbs import JsonOption, checked_input, new_app, print_json, verb
from sweeps.store.entries import SWEEPS, Entry, size_of

if TYPE_CHECKING:
    from sweeps.store.cleaning import Cleaned
    from sweeps.store.local import Store

app = new_app()


@verb(
    app,
    "examples/grid.yaml --dry-run",
    "runs/store --quota 50GB",
    failed="the results of sweeps exceed the quota",
)
def clean(
    store: Annotated[
        str, typer.Argument(help="YAML file of a sweep or a search, or folder or URL of a store")
    ],
    quota: Annotated[
        str | None,
        typer.Option(
            metavar="SIZE",
            help="remove only as much as needed to keep the store below this size: 50GB",
        ),
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="print what would be removed")] = False,
    forget: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="a sweep whose results may be removed")
    ] = None,
    unlocked: Annotated[
        bool,
        typer.Option("--unlocked", help="assert that no sweep uses the store; required for a URL"),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Show the sizes of a store and remove what no sweep or search refers to.

    A sweep refers to the results of its last configuration. A store that a sweep uses is left
    alone. A store at a URL needs --unlocked, because no lock shows whether a sweep uses it;
    --dry-run locks nothing."""
    from pydantic import ByteSize, TypeAdapter, ValidationError

    from sweeps.store.cleaning import clean_store

    with checked_input():
        if dry_run and forget:
            raise InputError("cannot be combined with --dry-run", place="--forget")
        try:
            limit = None if quota is None else TypeAdapter(ByteSize).validate_python(quota)
        except ValidationError:
            expected = "a size such as 500MB or 50GB"
            raise InputError(place="--quota", expected=expected, found=quota) from None
        opened = _store_of(store)
        with nullcontext() if unlocked or dry_run else opened.exclusive():
            opened.forget(*forget or ())
            cleaned = clean_store(opened, limit, dry_run)
    if as_json:
        print_json(summary_of(cleaned, dry_run))
    else:
        print_cleaned(output(), cleaned, dry_run, limit)
    if limit is not None and cleaned.kept_bytes > limit:
        raise typer.Exit(1)


def _store_of(name: str) -> Store:
    """Return the store of a file, or the one of that name. Raises ValueError if there is none."""
    from sweeps.store.open import open_store, store_of
    from sweeps.store.remote import RemoteStore
    from sweeps.sweep_or_search import read_either

    if Path(name).suffix in (".yaml", ".yml"):
        opened = store_of(read_either(Path(name)))
    else:
        opened = open_store(name, Path())
    if not isinstance(opened, RemoteStore) and not (opened.folder / SWEEPS).is_dir():
        raise InputError("not a store; no sweep has stored results there", place=opened.folder)
    return opened


def print_cleaned(console: Console, cleaned: Cleaned, dry_run: bool, limit: int | None) -> None:
    """Print the sizes of a store, and what was removed."""
    summary, whole = summary_of(cleaned, dry_run), _of_results(_results(cleaned), cleaned)
    rows = ((stage, *_counted(*counts.values())) for stage, counts in summary["stages"].items())
    stages = table(None, ("stage", "results", "size", "of no sweep", "size of these"), rows)
    stages.add_row("all", *_counted(*whole.values()), style="bold")
    console.print(stages)
    usable = [e for e in cleaned.contents if e.kind == "working" and e not in cleaned.leftovers]
    console.print(f"checkpoints of unfinished trainings: {_told(usable)}")
    console.print(f"leftovers of killed processes: {_told(cleaned.leftovers)}")
    rows = ((n, counts["refers_to"], *_counted(counts)) for n, counts in summary["sweeps"].items())
    console.print(table(None, ("sweep", "refers to", "of these there", "size"), rows))
    verb = "would be removed" if dry_run else "removed"
    console.print(f"{verb}: {_told(cleaned.removed)}; left: {decimal(cleaned.kept_bytes)}")
    if limit is not None and cleaned.kept_bytes > limit:
        larger = f"what sweeps refer to is larger than {decimal(limit)}"
        hint = "name those that are needed no more with --forget"
        console.print(f"{larger}; {hint}", soft_wrap=True)


def summary_of(cleaned: Cleaned, dry_run: bool) -> dict[str, Any]:
    """Return the summary for a script, sizes in bytes."""
    results = _results(cleaned)
    return {
        "dry_run": dry_run,
        "stages": {
            stage: _of_results([entry for entry in results if entry.stage == stage], cleaned)
            for stage in dict.fromkeys(entry.stage for entry in results)
        },
        "sweeps": {
            name: {"refers_to": len(keys), **_sizes([e for e in results if e.key in keys])}
            for name, keys in cleaned.references.items()
        },
        "leftovers": _sizes(cleaned.leftovers),
        "removed": _sizes(cleaned.removed),
        "left_bytes": cleaned.kept_bytes,
    }


def _results(cleaned: Cleaned) -> list[Entry]:
    return [entry for entry in cleaned.contents if entry.kind == "result"]


def _of_results(results: Collection[Entry], cleaned: Cleaned) -> dict[str, dict[str, int]]:
    unused = [entry for entry in results if entry.key not in cleaned.referred]
    return {"all": _sizes(results), "of_no_sweep": _sizes(unused)}


def _sizes(entries: Collection[Entry]) -> dict[str, int]:
    return {"count": len(entries), "bytes": size_of(entries)}


def _counted(*sizes: Mapping[str, int]) -> list[str]:
    return [cell for size in sizes for cell in (str(size["count"]), decimal(size["bytes"]))]


def _told(entries: Collection[Entry]) -> str:
    return f"{len(entries)} ({decimal(size_of(entries))})"
