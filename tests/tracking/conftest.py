import shutil
from pathlib import Path

import pytest

from tests.tracking.made_up_run import write_run
from tests.tracking.mlflow_runs_of import new_store
from tracking.report.build import build_report
from tracking.run_folders.sweep import RunFolder


@pytest.fixture(scope="session")
def made_up_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run folder of 5 placements, 2 seeds and 3 classes. Read it only; copy it to change it."""
    return write_run(tmp_path_factory.mktemp("runs") / "grid")


@pytest.fixture(scope="session")
def run(made_up_run: Path) -> RunFolder:
    """Run folder of `complete`, read; some modules define a fixture of their own."""
    return RunFolder.read(made_up_run)


@pytest.fixture(scope="session")
def reported_run(made_up_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run folder with its whole report, and with tables of an earlier one. Read it only."""
    folder = tmp_path_factory.mktemp("reported") / "grid"
    shutil.copytree(made_up_run, folder)
    (folder / "tables").mkdir()
    (folder / "tables" / "of-an-older-report.csv").write_text("a\n1\n")
    (folder / "tables" / "mine.txt").write_text("kept")
    build_report(folder)
    return folder


@pytest.fixture
def uri(tmp_path: Path) -> str:
    """Address of a new database of MLflow."""
    return new_store(tmp_path / "store")
