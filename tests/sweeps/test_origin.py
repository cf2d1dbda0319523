"""A run folder belongs to one configuration."""

from pathlib import Path

import pytest
import yaml

from sweeps.command_line import app
from sweeps.configuration.grid import read_sweep
from sweeps.results.origin import check_origin, record_origin
from tests.refused import refused
from tests.sweeps.small_log import TOWN
from tests.sweeps.toy import call

SWEEP = {"scene": TOWN, "ray": "debug", "detector": None, "grid": {"placement": ["line"]}}
ROOT = Path(__file__).parents[2]


@pytest.fixture
def first(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for folder in ("a", "b"):
        Path(folder).mkdir()
        Path(folder, "sweep.yaml").write_text(yaml.safe_dump(SWEEP))
    Path("runs/sweep").mkdir(parents=True)
    record_origin(read_sweep(Path("a/sweep.yaml")))
    return Path("a/sweep.yaml")


def test_another_file_of_the_same_name_is_refused_before_any_work(first):
    for options in ([], ["--dry-run"]):
        call(app, "run", "b/sweep.yaml", *options, code=2)
        line = (
            "runs/sweep: .*another file; expected a/sweep.yaml, found b/sweep.yaml; .* --set name="
        )
        with refused(line):
            check_origin(read_sweep(Path("b/sweep.yaml")))
    assert not Path("runs/store").exists()
    for other in (["name=sweep_2"], ["output=other"]):
        check_origin(read_sweep(Path("b/sweep.yaml"), other))


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ("grid.seed=[0,1,2]", None),
        ("grid.placement=[line,center]", None),
        ("training.epochs=12", None),
        ("scene.test_routes=12", None),
        ("grid.scene.seed=[1,2]", None),
        ("scene.seed=7", "scene.seed"),
        ("scene.towns=[Town03]", "scene.towns"),
    ],
)
def test_the_same_file_may_grow_but_not_change_its_scene(first, change, key):
    sweep = read_sweep(first.resolve(), [change])
    if key is None:
        record_origin(sweep)
        return
    with refused(("runs/sweep", key, "")):
        record_origin(sweep)


def test_a_folder_that_was_moved_with_its_file_goes_on(first, monkeypatch):
    Path("project").mkdir()
    for name in ("a", "b", "runs"):
        Path(name).rename(Path("project", name))
    monkeypatch.chdir("project")
    check_origin(read_sweep(first))
    first.rename("renamed.yaml")
    check_origin(read_sweep(Path("renamed.yaml"), ["name=sweep"]))


def test_examples_have_names_of_their_own():
    files = [*ROOT.glob("examples/*.yaml"), *ROOT.glob("examples/*/sweep.yaml")]
    names = [yaml.safe_load(file.read_text()).get("name", file.stem) for file in files]
    assert len(set(names)) == len(names)
