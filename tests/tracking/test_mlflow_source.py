"""Tags that fill MLflow's columns Source, User and Version."""

from __future__ import annotations

import subprocess
from importlib.metadata import version

import tracking
from tracking.mlflow.source import source_tags


def git(folder, *words):
    own = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
    subprocess.run(["git", "-C", folder, *own, *words], check=True, capture_output=True)


def test_in_a_checkout_the_commit_and_whether_files_differ(tmp_path, monkeypatch):
    monkeypatch.setattr(tracking, "__path__", [str(tmp_path / "tracking")])
    tags = source_tags()
    assert tags["lidarplace.version"] == version("lidarplace")
    assert tags["mlflow.source.type"] == "LOCAL"
    assert tags["mlflow.source.name"]
    assert tags["mlflow.user"]
    assert not [name for name in tags if "git" in name]

    (tmp_path / "code.py").write_text("x = 1\n")
    git(tmp_path, "init")
    git(tmp_path, "add", "code.py")
    assert not [name for name in source_tags() if "git" in name], "there is no commit yet"
    git(tmp_path, "commit", "-m", "code")
    tags = source_tags()
    assert len(tags["mlflow.source.git.commit"]) == 40
    assert tags["mlflow.source.git.dirty"] == "false"
    (tmp_path / "code.py").write_text("x = 2\n")
    assert source_tags()["mlflow.source.git.dirty"] == "true"
