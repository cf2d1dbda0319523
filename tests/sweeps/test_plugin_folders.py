"""Configurations whose folders have plug-ins of one name, read in one process."""

import sys
from unittest.mock import patch

import pytest

from lidarplace.base.code_version import code_version
from lidarplace.base.plugin_folders import PLUGINS, plugin_folder
from lidarplace.pog.surrogates.table import SURROGATES
from sweeps.execution.ray_cluster import _plug_ins
from sweeps.plan.plan import read_plan
from tests.refused import refused
from tests.sweeps.small_log import write_sweep

PLUGIN = """
from lidarplace.pog.surrogates.table import Surrogate
from plug_two.inner import LABEL
def compute(seen):
    import plug_helper
    return plug_helper.VALUE
ONE = Surrogate(label=LABEL, unit="", meaning="a constant", of_seen=compute, sense=0)
"""


def write_project(folder, value):
    """A sweep whose surrogate is `value` in every rig, by a package and a module next to it."""
    (folder / "plug_two").mkdir(parents=True)
    (folder / "plug_two/__init__.py").write_text(PLUGIN)
    (folder / "plug_two/inner.py").write_text(f"LABEL = 'constant {value}'\n")
    (folder / "plug_helper.py").write_text(f"VALUE = {value}\n")
    names = {"names": ["plug_two:ONE"], "resolution": 1.0, "accuracy": False}
    names |= {"sampling_error": False}
    return write_sweep(folder, surrogate=names, placement="line")


@pytest.fixture
def projects(tmp_path):
    imported = set(sys.modules)
    with patch.dict(PLUGINS, clear=True):
        yield [write_project(tmp_path / name, value) for name, value in (("a", 1.5), ("b", 2.5))]
    for name in set(sys.modules) - imported:
        if name.startswith("plug_"):
            del sys.modules[name]


def test_each_configuration_has_its_own_plugins(projects):
    path = [*sys.path]
    for project in projects:
        read_plan(project)
    assert sys.path == path
    versions = set()
    for project, label in zip(projects, ("constant 1.5", "constant 2.5"), strict=True):
        with plugin_folder(project.parent):
            assert SURROGATES["plug_two:ONE"].label == label
            assert SURROGATES["plug_two:ONE"].of_seen(None) == float(label.split()[1])
            versions.add(code_version("plug_two"))
            assert _plug_ins() == [str(project.parent / "plug_two")]
    assert len(versions) == 2
    assert sys.path == path


def test_a_folder_of_another_configuration_is_not_searched(projects, tmp_path):
    read_plan(projects[0])
    (tmp_path / "b/plug_two/__init__.py").rename(tmp_path / "b/plug_two/gone")
    (tmp_path / "b/plug_two").rename(tmp_path / "b/elsewhere")
    with refused("plug_two:ONE: cannot be imported: ModuleNotFoundError"):
        read_plan(projects[1])
