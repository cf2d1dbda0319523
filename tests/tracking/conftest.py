from pathlib import Path

import pytest
from made_up_run import write_run


@pytest.fixture(scope="session")
def made_up_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run folder of 5 placements, 2 seeds and 3 classes. Read it only; copy it to change it."""
    return write_run(tmp_path_factory.mktemp("runs") / "grid")
