"""The site of docs/, the image and the workflow: what their files say, and that the site builds."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from sweeps.execution.checks import SUMO_LIBRARIES
from tests.test_docs_links import LINK, text_of
from tests.tracking.made_up_run import write_run

ROOT = Path(__file__).parents[1]


class Loader(yaml.SafeLoader):
    """Reads MkDocs's file without its environment and functions."""


Loader.add_multi_constructor("!ENV", lambda loader, _, node: loader.construct_sequence(node))
Loader.add_multi_constructor("tag:yaml.org,2002:python/", lambda *_: None)


def test_the_menu_is_the_index():
    """Four parts of the same pages, in the same order."""
    config = yaml.load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"), Loader)
    menu = {
        part: re.findall(r"[\w/]+\.md", str(entries))
        for section in config["nav"]
        for part, entries in section.items()
    }
    parts = re.split(r"^## ", text_of(ROOT / "docs/index.md"), flags=re.M)[1:]
    index = {
        part.partition("\n")[0]: [link.replace("../", "source/") for link in LINK.findall(part)]
        for part in parts
    }
    menu["Start"] = [p for p in menu["Start"] if p != "index.md" and "notebooks" not in p]
    assert {part: sorted(pages) for part, pages in menu.items()} == {
        part: sorted(pages) for part, pages in index.items()
    }


@pytest.mark.long
def test_the_site_builds_and_loads_nothing_from_elsewhere(tmp_path):
    demo = write_run(tmp_path / "demo")
    for name in ("decision", "failures", "report"):
        (demo / f"{name}.html").write_text(f"<p>the {name} page</p>")
    site = tmp_path / "site"
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(site)]
    result = subprocess.run(
        command,
        cwd=ROOT,
        env=os.environ | {"LIDARPLACE_DEMO": str(demo), "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
    )
    assert result.returncode == 0, result.stderr
    for page in demo.glob("*.html"):
        assert (site / "demo" / page.name).read_bytes() == page.read_bytes()
    for name, output in {
        "quickstart": "expected_recall",
        "box_log": "unseen (%)",
        "sweep": "std",
    }.items():
        text = (site / f"source/examples/notebooks/{name}.html").read_text()
        assert f"<th>{output}</th>" in text
        assert "Plotly.newPlot" in text
    pages = sorted(site.rglob("*.html"))
    assert len(pages) > len(list((ROOT / "docs").glob("*.md")))
    loaded = r'<(script|img|iframe|source)[^>]* src="?(http|//)|<link[^>]*style[^>]*href="?http'
    for page in pages:
        assert not re.search(loaded, page.read_text(encoding="utf-8")), page.name
    (demo / "report.html").unlink()
    result = subprocess.run(
        command, cwd=ROOT, env=os.environ | {"LIDARPLACE_DEMO": str(demo)}, capture_output=True
    )
    assert b"report.html: no such file; run `make demo`" in result.stderr


def test_the_workflow_runs_what_make_has():
    text = (ROOT / ".github/workflows/ci.yml").read_text(encoding="utf-8")
    jobs = yaml.safe_load(text)["jobs"]
    targets = {*jobs["make"]["strategy"]["matrix"]["target"], *re.findall(r"make ([\w-]+)", text)}
    assert {"test", "lint", "wheel", "docs", "test-long"} <= targets
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in targets:
        assert re.search(rf"^{target}:", makefile, re.M), target
    for job in jobs.values():
        assert all(("uses" in step) != ("run" in step) for step in job["steps"])


def test_images():
    """Both copy what is in the checkout and install SUMO's libraries; hadolint agrees, if any."""
    paths = [ROOT / "Dockerfile", ROOT / "examples/cluster/Dockerfile"]
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    packages = []
    for path in paths:
        text = path.read_text(encoding="utf-8").replace("\\\n", " ")
        lines = [line.split() for line in text.splitlines() if re.match("[A-Z]+ ", line)]
        assert (lines[0][0], lines[1][0]) == ("FROM", "ARG")
        for *sources, _ in (words[1:] for words in lines if words[0] == "COPY"):
            assert all((ROOT / source).exists() for source in sources)
        extras = re.search(r'"\.\[(.+?)\]"', text)[1].split(",")
        assert all(f"\n{extra} = [" in project for extra in extras)
        (install,) = (words for words in lines if words[:2] == ["RUN", "apt-get"])
        packages.append({word for word in install if re.fullmatch(r"lib\w+-?\d", word)})
    assert packages == [set(SUMO_LIBRARIES)] * 2
    workflow = (ROOT / ".github/workflows/ci.yml").read_text(encoding="utf-8")
    assert workflow.count(" ".join(SUMO_LIBRARIES)) == 3
    ignored = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    copied = re.findall(r"^COPY (.+) \S+$", paths[0].read_text(encoding="utf-8"), re.M)
    assert {f"!{name}" for line in copied for name in line.split()} <= set(ignored)
    if shutil.which("hadolint"):
        subprocess.run(["hadolint", *paths], check=True)
