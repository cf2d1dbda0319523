"""Sizes of a store, and room in it: `python -m sweeps.clean grid.yaml`."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lidarplace.command_line.terminal import output
from lidarplace.command_line.verbs import JsonOption, new_app, print_json, verb, wrong

if TYPE_CHECKING:
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
    from sweeps.print_cleaned import print_cleaned, summary_of
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
    from sweeps.store.entries import SWEEPS
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


if __name__ == "__main__":
    app()
