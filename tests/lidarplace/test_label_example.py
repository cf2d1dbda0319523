"""The label file of the examples is converted as docs/label_files.md shows."""

import yaml
from typer.testing import CliRunner

from lidarplace.commands.convert import app
from lidarplace.scenes.label_tables.propose import propose_mapping
from tests.docs_blocks import ROOT, blocks

LABELS, MAP = "examples/labels/labels.csv", "examples/labels/map.yaml"


def printed(language, start):
    """The block of docs/label_files.md that starts so."""
    of_page = [block.text for block in blocks(language) if block.page == "label_files.md"]
    return next(text for text in of_page if text.startswith(start))


def convert(out, mapping):
    arguments = ["table", LABELS, str(out), "--mapping", str(mapping)]
    return CliRunner().invoke(app, arguments)


def test_the_guess(monkeypatch):
    monkeypatch.chdir(ROOT)
    assert propose_mapping(ROOT / LABELS) == printed("yaml", "# A guess")


def test_the_log(tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("FORCE_COLOR", "1")  # as in a terminal, one without colours
    monkeypatch.setenv("TERM", "dumb")
    result = convert(tmp_path / "labels", MAP)
    assert result.exit_code == 0, result.stderr
    assert result.stdout.replace(str(tmp_path), "logs") == printed("text", "Frames")


def test_what_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    content = yaml.safe_load((ROOT / MAP).read_text(encoding="utf-8"))
    content["units"]["angle"] = "rad"
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(content))
    result = convert(tmp_path / "log", tmp_path / "map.yaml")
    assert result.exit_code == 2
    assert result.stderr == printed("text", "examples/labels")
