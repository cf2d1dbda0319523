"""The store that a configuration names, and the name of its sweep there."""

import hashlib

from lidarplace.files.atomic import check_takes_files
from sweeps.configuration.file import ConfigError
from sweeps.configuration.grid import Sweep
from sweeps.store.open import AnyStore, open_store
from sweeps.store.remote import RemoteStore


def store_of(sweep: Sweep) -> AnyStore:
    """The store of a sweep.

    Raises:
        ConfigError: its URL is of no known kind or cannot be had, a quota is given for a URL, or
            the store is the run folder.
    """
    settings = sweep.common.store
    try:
        store = open_store(settings.url, sweep.common.output, settings.cache)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    remote = isinstance(store, RemoteStore)
    if remote and settings.quota_gb is not None:
        raise ConfigError("store.quota_gb: is for folders; a URL has no lock that keeps it safe")
    folder = store.local.folder
    if folder.absolute() == (sweep.common.output / sweep.common.name).absolute():
        raise ConfigError(f"name: the run folder would be the store {folder}; choose another name")
    return store


def check_writable(sweep: Sweep, store: AnyStore) -> None:
    """Try whether the run folder and the folder of the store, or of its copies, take files.

    What is wrong with a folder does not mend itself, unlike a disk that fills up in the middle.

    Raises:
        OSError: names the folder that cannot be written.
    """
    for folder in (sweep.common.output / sweep.common.name, store.local.folder):
        check_takes_files(folder)


def reference(sweep: Sweep, purpose: str = "") -> str:
    """The name under which a sweep refers to results; sweeps of other output folders have others.

    Args:
        purpose: tells what else is made of a sweep from it, such as "pretrain".
    """
    place = hashlib.sha256(str(sweep.common.output.resolve()).encode()).hexdigest()[:6]
    return ".".join(filter(None, [sweep.common.name, purpose, place]))
