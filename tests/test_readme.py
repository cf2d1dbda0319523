"""What the README shows works as it stands there."""

import re
from pathlib import Path

import pandas as pd

from sweeps.grid import read_sweep

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def block(language: str) -> str:
    (text,) = re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)
    return text


def test_the_configuration(tmp_path):
    path = tmp_path / "grid.yaml"
    path.write_text(block("yaml"))
    points = [g.point for g in read_sweep(path).points]
    assert len(points) == 15
    assert not any(p.placement == "mine" and p.scene.density == 40 for p in points)


def test_the_lines_of_python(tmp_path, monkeypatch, capsys):
    boxes = pd.read_csv(ROOT / "tests/data/smig/boxes.csv")
    boxes.to_parquet(tmp_path / "boxes.parquet")
    monkeypatch.chdir(tmp_path)
    exec(block("python"), {})
    assert "s_mig=-" in capsys.readouterr().out


def test_links_and_pictures_are_there():
    targets = re.findall(r"\]\(([^)#:]+)\)", README)
    assert "docs/method.md" in targets
    for target in targets:
        assert (ROOT / target).is_file(), target
