"""The store of a configuration, and what a sweep is called there."""

from pathlib import Path

import yaml

from sweeps.configuration.grid import read_sweep
from sweeps.store.local import Store
from sweeps.store.open import reference, store_of
from sweeps.store.remote import RemoteStore


def sweep(folder, **settings):
    path = folder / "grid.yaml"
    path.write_text(
        yaml.safe_dump({"placement": "line", "output": str(folder / "runs")} | settings)
    )
    return read_sweep(path)


def test_the_default_is_a_folder_beside_the_runs(tmp_path):
    assert store_of(sweep(tmp_path)) == Store(tmp_path / "runs/store")


def test_folders_and_urls(tmp_path):
    assert store_of(sweep(tmp_path, store=str(tmp_path / "a"))) == Store(tmp_path / "a")
    found = store_of(sweep(tmp_path, store={"url": "memory://b/", "cache": str(tmp_path / "c")}))
    assert isinstance(found, RemoteStore)
    assert found.cache == tmp_path / "c"


def test_sweeps_of_one_name_in_two_folders_refer_apart(tmp_path):
    here, there = sweep(tmp_path), sweep(tmp_path, output=str(tmp_path / "other"))
    assert reference(here) != reference(there)
    assert reference(here) == reference(sweep(tmp_path, output=f"{tmp_path}/./runs"))
    assert reference(here).startswith("grid.")
    assert reference(here, "pretrain") != reference(here)
    assert Path(reference(here)).name == reference(here)
