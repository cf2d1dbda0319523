"""The store that a configuration names, a folder or a URL, and the name of its sweep there."""

import hashlib
from pathlib import Path

from fsspec import get_filesystem_class

from lidarplace.base.errors import InputError, at
from lidarplace.files.atomic import check_takes_files
from lidarplace.files.secret_urls import check_whole, hide_secrets, public_url
from sweeps.configuration.file import ConfigError
from sweeps.configuration.grid import Sweep
from sweeps.store.entries import SWEEPS
from sweeps.store.local import Store
from sweeps.store.remote import RemoteStore


def open_store(url: str | None, output: Path, cache: Path | None = None) -> Store:
    """Return the store at a folder, or at a URL that fsspec knows.

    `output/store` is the default of the folder, and of `cache`, the folder of copies. Nothing is
    written; a URL is tried. Raises InputError: it has an unknown protocol, needs a package, or
    cannot be read."""
    default = (output / "store").absolute()
    if url is None:
        return Store(default)
    protocol, separator, path = url.partition("://")
    if not separator or protocol == "file":
        return Store(Path(path if separator else url).absolute())
    check_whole("store", url)
    try:
        get_filesystem_class(protocol)
    except ImportError as error:
        needed = getattr(error.__cause__, "name", None)
        problem = f"{protocol}:// needs the package {needed}"
        raise InputError(problem, key="store", fix=f"pip install {needed}") from None
    except ValueError:
        problem = f"fsspec has no protocol {protocol!r}"
        raise InputError(problem, key="store", found=public_url(url)) from None
    store = RemoteStore((cache or default).absolute(), url.rstrip("/"))
    try:
        store.find(SWEEPS)
    except Exception as error:  # each remote place has errors of its own
        reason = hide_secrets(f"{type(error).__name__}: {error}", url)
        raise InputError(f"{public_url(url)}: cannot be read: {reason}", key="store") from None
    return store


def store_of(sweep: Sweep) -> Store:
    """Return the store of a sweep.

    Raises ConfigError: see `open_store`; a quota is set for a URL, or the store is the run folder.
    """
    settings = sweep.common.store
    with at(error=ConfigError):
        store = open_store(settings.url, sweep.common.output, settings.cache)
    if isinstance(store, RemoteStore) and settings.quota_gb is not None:
        raise ConfigError("applies to folders only; a URL has no lock", key="store.quota_gb")
    if store.folder.absolute() == (sweep.common.output / sweep.common.name).absolute():
        problem, fix = f"the run folder would be the store {store.folder}", "choose another name"
        raise ConfigError(problem, key="name", fix=fix)
    return store


def check_writable(sweep: Sweep, store: Store) -> None:
    """Check that the run folder and the folder of the store, or of its copies, take files.

    Raises OSError: unlike a disk that fills up later, a faulty folder stays faulty."""
    for folder in (sweep.common.output / sweep.common.name, store.folder):
        check_takes_files(folder)


def reference(sweep: Sweep, purpose: str = "") -> str:
    """Return the name under which a sweep refers to results, such as for the purpose "pretrain".

    Sweeps of other output folders have other names."""
    place = hashlib.sha256(str(sweep.common.output.resolve()).encode()).hexdigest()[:6]
    return ".".join(filter(None, [sweep.common.name, purpose, place]))
