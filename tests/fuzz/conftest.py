"""The world of right files, written once a process."""

from pathlib import Path

import pytest

from tests.fuzz.world import write_world


@pytest.fixture(scope="session")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Read it only: a case takes a copy."""
    folder = tmp_path_factory.mktemp("fuzz") / "world"
    write_world(folder)
    return folder
