"""Links of pages lead somewhere: files, headings, pictures, hosts by encrypted connections."""

import re
from pathlib import Path

import pytest

from tests import docs_blocks
from tests.docs_blocks import ROOT

PAGES = [*docs_blocks.PAGES, ROOT / "CHANGELOG.md"]
LINK = re.compile(r"\]\(([^)\s]+)\)")


def text_of(page: Path) -> str:
    """A page without its blocks of code."""
    return re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)


def anchors(page: Path) -> set[str]:
    """Anchors of the headings of a page, as GitHub makes them."""
    seen: dict[str, int] = {}
    slugs = set()
    for heading in re.findall(r"^#+ (.*)$", text_of(page), re.M):
        title = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading)
        slug = re.sub(r"[^\w\- ]", "", title.strip().lower()).replace(" ", "-")
        slugs.add(f"{slug}-{seen[slug]}" if slug in seen else slug)
        seen[slug] = seen.get(slug, 0) + 1
    return slugs


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)
def test_links_lead_somewhere(page):
    for target in LINK.findall(text_of(page)):
        if "://" in target:
            assert re.fullmatch(r"https://[\w.-]+\.\w+(/\S*)?", target), target
            continue
        path, _, anchor = target.partition("#")
        linked = (page.parent / path).resolve() if path else page
        assert linked.exists(), f"{target}: no such file"
        assert linked.is_relative_to(ROOT), f"{target}: outside of the project"
        if anchor:
            assert anchor in anchors(linked), f"{target}: {path or page.name} has no such heading"


def test_every_page_and_picture_is_linked():
    targets = {
        (page.parent / target.partition("#")[0]).resolve()
        for page in PAGES
        for target in LINK.findall(text_of(page))
        if "://" not in target
    }
    index = ROOT / "docs/index.md"
    listed = {(index.parent / target).resolve() for target in LINK.findall(text_of(index))}
    for page in PAGES:
        named = page in listed or page in (index, ROOT / "README.md")
        assert named, f"docs/index.md does not link {page.name}"
    for picture in (path for kind in ("png", "svg") for path in (ROOT / "docs").glob(f"*.{kind}")):
        assert picture in targets, f"no page shows {picture.name}"


@pytest.mark.parametrize("page", ["architecture.md", "reproducibility.md"])
def test_files_that_a_page_names_are_there(page):
    named = re.findall(r"`([a-z_]+/[\w/]*(?:\.py)?)`", text_of(ROOT / "docs" / page))
    folders = [ROOT, *(ROOT / name for name in ("sweeps", "tracking", "training", "lidarplace"))]
    generated = ("runs/",)
    lost = [name for name in named if not any((folder / name).exists() for folder in folders)]
    assert named
    assert [name for name in lost if not name.startswith(generated)] == []


def test_anchors_are_githubs(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# `scene`, source: log\n## A [b](c.md) d\n```\n# no heading\n```\n## A b d\n")
    assert anchors(page) == {"scene-source-log", "a-b-d", "a-b-d-1"}


def test_files_of_python_that_pages_name_exist():
    files = {path.name for path in ROOT.glob("[!.]*/**/*.py")}
    for page in PAGES:
        named = set(re.findall(r"`(\w+\.py)`", text_of(page)))
        assert named <= files, f"{page.name}: {named - files}"
