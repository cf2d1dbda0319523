"""Regular files are read and nothing else, whoever reads."""

import os
import re

import pytest

from lidarplace.files.json_file import read_json
from lidarplace.files.regular import files_in, is_there, regular
from tests.fuzz.mutate_bytes import NO_FILES
from tests.test_layers import MODULES

READ = re.compile(
    r"(?<!regular\(path\))(\.read_bytes\(\)|\.read_text\(|\.open\(\"rb\"\))"
    r"|(np\.load|fromfile)\((?!regular)"
)
"""A file is opened, and not by what `regular` returns."""
OWN = {
    "lidarplace.clouds.cloud_files": "by regular itself",
    "lidarplace.configuration.correction": "of the package",
    "lidarplace.configuration.further_sensors": "of the package",
    "lidarplace.rigs.catalogue.datasheet": "of the package",
    "lidarplace.recall.detection_curve": "of the package",
    "lidarplace.requirements.presets.read": "of the package",
    "lidarplace.viewing.page": "of the package",
    "lidarplace.files.atomic": "fsync",
    "sweeps.command_line": "of an installed package",
    "sweeps.commands.init": "of the package",
    "lidarplace.base.code_version": "of the package",
    "sweeps.stages.command": "the log of the command",
    "sweeps.execution.memory": "of the kernel",
    "sweeps.execution.worker": "of the kernel",
    "sweeps.store.checkpoint_mirror": "of the store",
    "sweeps.store.local": "of the store",
    "sweeps.store.lock": "of the store",
    "sweeps.store.remote": "of the store",
    "sweeps.store.result_folder": "of the store",
    "training.nvidia": "of the kernel",
}
"""Modules that read what no user names."""


def test_every_reader_opens_what_is_regular():
    reads = {name for name, path in MODULES.items() if READ.search(path.read_text("utf-8"))}
    assert reads <= OWN.keys()


@pytest.mark.parametrize("what", NO_FILES)
def test_what_is_no_file_is_named_and_never_opened(tmp_path, what):
    path = tmp_path / "labels.csv"
    NO_FILES[what](path)
    assert is_there(path)
    with pytest.raises(OSError, match=r"labels\.csv") as raised:
        regular(path)
    assert raised.value.filename == str(path)
    assert raised.value.strerror


def test_files_and_links_to_them_are_read(tmp_path):
    path, link = tmp_path / "a", tmp_path / "b"
    assert not is_there(path)
    with pytest.raises(FileNotFoundError):
        regular(path)
    path.write_text("text")
    os.symlink("a", link)
    assert regular(path).read_text() == regular(link).read_text() == "text"
    with pytest.raises(NotADirectoryError):
        is_there(path / "train.txt")


def test_hidden_files_are_no_data_and_a_mark_at_the_start_is_no_json(tmp_path):
    """macOS writes `._NAME` beside NAME on foreign disks, Windows' editors a byte order mark."""
    for name in ("b.json", "._b.json", "a.json"):
        (tmp_path / name).write_bytes(b'\xef\xbb\xbf{"a": 1}')
    assert files_in(tmp_path) == [tmp_path / "a.json", tmp_path / "b.json"]
    assert read_json(tmp_path / "a.json") == {"a": 1}
