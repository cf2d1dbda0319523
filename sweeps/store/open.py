"""Open the store that a configuration names: a folder, or a URL."""

from pathlib import Path
from typing import TypeAlias

from fsspec import get_filesystem_class

from lidarplace.files.secret_urls import check_whole, hide_secrets, public_url
from sweeps.store.entries import SWEEPS
from sweeps.store.local import Store
from sweeps.store.remote import RemoteStore

AnyStore: TypeAlias = Store | RemoteStore
"""What results are kept in; the two have the same methods."""


def open_store(url: str | None, output: Path, cache: Path | None = None) -> AnyStore:
    """The store that a configuration names. Nothing is written; a URL is tried out.

    Args:
        url: a folder, or a URL that fsspec knows; `output/store` by default.
        cache: where copies from a URL are kept; `output/store` by default.

    Raises:
        ValueError: the protocol is not known, its package is not installed, or the place cannot be
            read.
    """
    own = (output / "store").absolute()
    if url is None:
        return Store(own)
    protocol, separator, path = url.partition("://")
    if not separator:
        return Store(Path(url).absolute())
    if protocol == "file":
        return Store(Path(path).absolute())
    check_whole("store", url)
    try:
        get_filesystem_class(protocol)
    except ImportError as error:
        needed = getattr(error.__cause__, "name", None)
        raise ValueError(
            f"store: {protocol}:// needs the package {needed}: pip install {needed}"
        ) from None
    except ValueError:
        shown = public_url(url)
        raise ValueError(f"store: {shown}: fsspec knows no protocol {protocol!r}") from None
    store = RemoteStore(url.rstrip("/"), (cache or own).absolute())
    try:
        store.find(SWEEPS)
    except Exception as error:  # each remote place has errors of its own
        reason = hide_secrets(f"{type(error).__name__}: {error}", url)
        raise ValueError(f"store: {public_url(url)}: cannot be read: {reason}") from None
    return store
