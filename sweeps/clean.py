"""Sizes of a store, and room in it: `python -m sweeps.clean grid.yaml`."""

from __future__ import annotations

from collections.abc import Collection
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.filesize import decimal
from rich.table import Table

from lidarplace.command_line.terminal import output
from lidarplace.command_line.verbs import JsonOption, new_app, print_json, verb, wrong
from sweeps.store.entries import SWEEPS, Entry, size_of

if TYPE_CHECKING:
    from sweeps.store.cleaning import Cleaned
    from sweeps.store.open import AnyStore

app = new_app()


@verb(
    app,
    "examples/grid.yaml --dry-run",
    "runs/store --quota 50GB",
    failed="what sweeps refer to is larger than the quota",
)
def clean(
    store: Annotated[
        str,
        typer.Argument(help="YAML file of a sweep or a search, or folder or URL of a store"),
    ],
    quota: Annotated[
        str | None,
        typer.Option(metavar="SIZE", help="remove only as much as keeps the store below: 50GB"),
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="remove nothing, tell all")] = False,
    forget: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="a sweep whose results are needed no more"),
    ] = None,
    unlocked: Annotated[
        bool, typer.Option("--unlocked", help="no sweep uses the store: trust me; needed for a URL")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Show the sizes of a store and remove what no sweep or search refers to.

    A sweep refers to the results of its last configuration. A store that a sweep uses is left
    alone. A store at a URL needs --unlocked, because no lock tells whether a sweep uses it;
    --dry-run locks nothing.
    """
    from sweeps.store.cleaning import clean_store

    try:
        if dry_run and forget:
            raise ValueError("--forget: leave it out with --dry-run, which changes nothing")
        limit = None if quota is None else _bytes(quota)
        opened = _store_of(store)
        with nullcontext() if unlocked or dry_run else opened.exclusive():
            opened.forget(*forget or ())
            cleaned = clean_store(opened, limit, dry_run)
    except (OSError, ValueError) as error:
        wrong(error)
    if as_json:
        print_json(summary_of(cleaned, dry_run))
    else:
        print_cleaned(output(), cleaned, dry_run, limit)
    if limit is not None and cleaned.kept_bytes > limit:
        raise typer.Exit(1)


def _store_of(name: str) -> AnyStore:
    """The store of a file, or the one of that name. Raises ValueError if there is none."""
    from sweeps.store.local import Store
    from sweeps.store.of_sweep import store_of
    from sweeps.store.open import open_store
    from sweeps.sweep_or_search import read_either

    if Path(name).suffix in (".yaml", ".yml"):
        opened = store_of(read_either(Path(name)))
    else:
        opened = open_store(name, Path())
    if isinstance(opened, Store) and not (opened.folder / SWEEPS).is_dir():
        raise ValueError(f"{opened.folder} is no store: no sweep has left its results there")
    return opened


def _bytes(size: str) -> int:
    from pydantic import ByteSize, TypeAdapter, ValidationError

    try:
        return int(TypeAdapter(ByteSize).validate_python(size))
    except ValidationError:
        raise ValueError(f"--quota {size}: expected a size such as 500MB or 50GB") from None


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


if __name__ == "__main__":
    app()
