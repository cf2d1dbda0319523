"""Names from outside: installed, in a folder, broken, provided twice, unknown."""

import sys
from typing import Annotated
from unittest.mock import patch

import pytest
from pydantic import BaseModel, ValidationError

from lidarplace.base.code_version import code_version, forget_versions
from lidarplace.base.plugin_folders import PLUGINS
from lidarplace.base.registry import OneOf, PluginError, Registry, _entry_points
from lidarplace.scenes.kinds import KINDS
from sweeps.execution.ray_cluster import _cluster_environment, _plug_ins, _python_path
from sweeps.stages.measure import MeasureStage
from sweeps.stages.recall import RecallStage


@pytest.fixture
def site(tmp_path, monkeypatch):
    """A folder on the path, in which `install` puts distributions of one module."""
    monkeypatch.syspath_prepend(tmp_path)
    _entry_points.cache_clear()
    forget_versions()
    with patch.dict(PLUGINS, clear=True):
        yield tmp_path
    _entry_points.cache_clear()
    forget_versions()
    for name in [name for name in sys.modules if name.startswith("plug_")]:
        del sys.modules[name]


def install(site, name, points, text="def one(): ...\n"):
    (site / f"{name}.py").write_text(text)
    info = site / f"{name}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[lidarplace.tests]\n" + "\n".join(points) + "\n")
    (info / "RECORD").write_text(f"{name}.py,,\n{info.name}/entry_points.txt,,\n")


def new():
    return Registry("lidarplace.tests", {"ours": len})


def test_installed_names_and_modules(site):
    install(site, "plug_a", ["first = plug_a:one"])
    things = new()
    assert list(things) == ["ours"]
    assert set(things.installed()) == {"ours", "first"}
    assert things["first"] is things["plug_a:one"]
    assert things.modules(["ours", "first"]) == ("plug_a",)
    assert "second" not in things
    assert things.get("second") is None


def test_a_broken_plug_in_harms_no_other(site, caplog):
    install(site, "plug_a", ["first = plug_a:one"])
    install(site, "plug_b", ["second = plug_b:one"], text="import no_such_package\n")
    install(site, "plug_c", ["third = plug_c:one"], text="one = 3\n")
    things = new()
    assert set(things.installed()) == {"ours", "first"}
    lines = [record.getMessage() for record in caplog.records]
    assert len(lines) == 2
    assert all("\n" not in line for line in lines)
    with pytest.raises(PluginError, match=r"second \(plug_b:one\): .*/plug_b.py:1: Mod"):
        things["second"]
    assert "plug_b" not in PLUGINS, "a local Ray would send it to its workers"
    with pytest.raises(PluginError, match="third") as error:
        things["third"]
    assert error.value.found == "int"


def test_a_kind_of_scenes_needs_a_class_of_settings(site):
    text = "from lidarplace.scenes.kinds import SceneKind\none = SceneKind({}, list)\n"
    install(site, "plug_a", [], text)
    with pytest.raises(PluginError, match="plug_a:one"):
        KINDS["plug_a:one"]


def test_a_name_that_two_provide(site, caplog):
    install(site, "plug_a", ["first = plug_a:one", "ours = plug_a:one"])
    install(site, "plug_b", ["first = plug_b:one"])
    things = new()
    with pytest.raises(PluginError, match=r"first: .* of plug_a and plug_b"):
        things["first"]
    assert things["ours"] is len
    with pytest.raises(PluginError, match=r"ours: .* of plug_a and lidarplace"):
        things.path("ours")
    assert set(things.installed()) == {"ours"}
    assert len(caplog.records) == 2


def test_settings_look_names_up_when_they_are_read(site):
    things = new()
    one_of = OneOf((things.where(lambda own: own is not None),), ("none",))

    class Model(BaseModel):
        thing: Annotated[str, one_of]

    assert Model(thing="ours").thing == "ours"
    assert Model(thing="none").thing == "none"
    install(site, "plug_a", ["first = plug_a:one"])
    _entry_points.cache_clear()
    assert Model(thing="first").thing == "first"
    assert Model(thing="plug_a:one").thing == "plug_a:one"
    names = Model.model_json_schema()["properties"]["thing"]["anyOf"][0]["enum"]
    assert set(names) == {"ours", "first", "none"}
    with pytest.raises(ValidationError) as error:
        Model(thing="frist")
    assert error.value.errors()[0]["type"] == "literal_error"
    with pytest.raises(ValidationError, match="plug_a:two: cannot be imported: AttributeError"):
        Model(thing="plug_a:two")


def test_keys_follow_the_code_of_a_plug_in(site):
    def keys():
        forget_versions()
        return code_version("lidarplace.base.errors"), code_version(
            "lidarplace.base.errors", "plug_a"
        )

    text = "import plug_b\ndef one(): return two()\ndef two(): return {}\n"
    install(site, "plug_a", [], text.format(2))
    install(site, "plug_b", [])
    without, with_it = keys()
    assert without != with_it
    (site / "plug_b.py").write_text("def one(): return 1\n")  # another package
    assert keys() == (without, with_it)
    (site / "plug_a.py").write_text(text.format(3))
    after = keys()
    assert after[0] == without
    assert after[1] != with_it


@pytest.mark.parametrize(("stage", "field"), [(RecallStage, "names"), (MeasureStage, "metrics")])
def test_a_stage_runs_the_code_of_surrogates_and_metrics_of_plug_ins(site, stage, field):
    own = object.__new__(stage)
    object.__setattr__(own, field, ("plug_a:ONE",))
    assert own.modules() == (stage.__module__, "plug_a")


def test_workers_get_packages_and_metadata(site):
    install(site, "plug_a", ["first = plug_a:one"])
    things = new()
    assert _plug_ins() == []
    things["first"]
    places = [str(site / "plug_a.py"), str(site / "plug_a-1.0.dist-info")]
    assert _plug_ins() == places
    assert _cluster_environment()["py_modules"][-2:] == places
    assert str(site) in _python_path().split(":")
