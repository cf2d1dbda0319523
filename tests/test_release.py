"""Places that a release changes together agree."""

import re
import tomllib
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_the_citation():
    """The keys that the Citation File Format 1.2.0 asks for, of software and of a reference."""
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["cff-version"] == "1.2.0"
    assert {"message", "title", "authors"} <= set(citation)
    assert (citation["title"], citation["type"]) == (PROJECT["name"], "software")
    assert citation["license"] == PROJECT["license"]
    assert citation["version"] == PROJECT["version"]
    (paper,) = citation["references"]
    assert {"type", "title", "authors"} <= set(paper)
    for author in (*citation["authors"], *paper["authors"]):
        assert set(author) in ({"name"}, {"family-names", "given-names"})


def test_the_changelog():
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    sections = re.findall(r"^## (\S+)", text, re.M)
    assert sections[0] == "Unreleased"
    assert PROJECT["version"] in sections
    kinds = {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}
    assert set(re.findall(r"^### (.*)", text, re.M)) <= kinds


def test_hooks_check_what_make_lint_checks():
    hooks = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))["repos"]
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    (recipe,) = re.findall(r"^lint: setup\n((?:\t.*\n)+)", makefile, re.M)
    lines = [line.strip().replace("$(BIN)", ".venv/bin") for line in recipe.splitlines()]
    assert [hook["entry"] for repository in hooks for hook in repository["hooks"]] == [
        line.removesuffix(" .") for line in lines
    ]


def test_images_of_the_cluster():
    for path in sorted((ROOT / "examples/cluster").iterdir()):
        for version in re.findall(r"lidarplace:([\d.]+)", path.read_text(encoding="utf-8")):
            assert version == PROJECT["version"], path.name
