"""Who runs which code, by the tags that MLflow's pages show: Source, User, Version."""

import subprocess
from importlib.metadata import version
from pathlib import Path

import tracking

VERSION_TAG = "lidarplace.version"


def source_tags() -> dict[str, str]:
    """Tags of MLflow for this process, and the version of lidarplace.

    In a checkout with git the commit, and whether files differ from it.
    """
    from mlflow.tracking.context.default_context import DefaultRunContext
    from mlflow.utils.mlflow_tags import MLFLOW_GIT_COMMIT, MLFLOW_GIT_DIRTY

    tags = {name: str(value) for name, value in DefaultRunContext().tags().items()}
    tags[VERSION_TAG] = version("lidarplace")
    root = Path(tracking.__path__[0]).parent
    if (root / ".git").exists():
        commit = _git(root, "rev-parse", "HEAD")
        changed = _git(root, "status", "--porcelain", "--untracked-files=no")
        if commit is not None and changed is not None:
            tags[MLFLOW_GIT_COMMIT] = commit
            tags[MLFLOW_GIT_DIRTY] = str(bool(changed)).lower()
    return {name: value for name, value in tags.items() if value}


def _git(root: Path, *words: str) -> str | None:
    """What git prints; None where it is not installed, or refuses."""
    try:
        done = subprocess.run(
            ["git", "-C", str(root), *words], capture_output=True, text=True, timeout=30
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return None if done.returncode else done.stdout.strip()
