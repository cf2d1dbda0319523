"""What killed runs were writing is removed when the next one starts."""

from lidarplace.files.atomic import remove_leftovers
from sweeps.configuration.sweep import Common
from sweeps.store.open import AnyStore
from tracking.mlflow.uri import sqlite_file


def remove_leftovers_of(common: Common, store: AnyStore) -> None:
    """Remove them from the run folder, from beside MLflow's database and from the store.

    The store may be shared: what a running process or another host writes stays.
    """
    remove_leftovers(common.output / common.name, "**/.*.part*")
    if (database := sqlite_file(common.tracking_uri)) is not None:
        remove_leftovers(database.parent)
    remove_leftovers(store.local.folder, "*/.*.part*")
