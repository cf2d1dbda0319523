"""The key `judge`, which is called `evaluator` now, in files and run folders of older versions."""

import json

import pandas as pd
import pytest
import yaml

from sweeps.configuration.file import check, read_named
from sweeps.configuration.grid import read_sweep
from sweeps.configuration.search import SearchFile
from tests.refused import refused
from tests.sweeps.search_files import write_search
from tests.tracking.made_up_run import NAMES, write_run
from tracking.findings.evidence import value_at
from tracking.findings.groups import groups
from tracking.run_folders.sweep import RunFolder

COMMAND = {"command": "a {clouds} {detections}", "format": "kitti"}


@pytest.mark.parametrize(
    ("keys", "overrides"),
    [
        ({"judge": "pretrained"}, []),
        (
            {"grid": {"judge": ["generalist", "pretrained"]}, "exclude": [{"judge": "generalist"}]},
            [],
        ),
        ({}, ["judge=pretrained"]),
        ({}, ["grid.judge=[pretrained]"]),
        ({}, ["grid={judge: [pretrained]}"]),
        ({"evaluator": "generalist"}, ["judge=pretrained"]),
        ({"evaluator": COMMAND}, ["judge=pretrained"]),
    ],
)
def test_the_old_key_works_with_one_warning(tmp_path, caplog, keys, overrides):
    path = tmp_path / "sweep.yaml"
    path.write_text(yaml.safe_dump({"placement": "line", **keys}))
    sweep = read_sweep(path, overrides)
    assert [own.point.evaluator for own in sweep.points] == ["pretrained"]
    assert "judge" not in {*sweep.source, *sweep.source.get("grid", {}), *sweep.axes}
    (warning,) = caplog.messages
    assert warning.startswith(f"warning: {path}: judge: ")


def test_the_new_key_works_without_a_warning(tmp_path, caplog):
    path = tmp_path / "sweep.yaml"
    path.write_text(yaml.safe_dump({"placement": "line", "evaluator": COMMAND}))
    (point,) = read_sweep(path, ["evaluator.cpus=2", "seed=3"]).points
    assert point.point.evaluator.cpus == 2
    assert not caplog.messages


@pytest.mark.parametrize(
    ("keys", "key"),
    [
        ({"judge": "pretrained", "evaluator": "pretrained"}, "judge"),
        ({"grid": {"judge": ["pretrained"], "evaluator": ["pretrained"]}}, "grid.judge"),
        (
            {"promote": [{"set": {"evaluator": "generalist", "judge": "generalist"}}]},
            "promote[0].set.judge",
        ),
    ],
)
def test_both_names_at_once_are_an_error(tmp_path, keys, key):
    path = tmp_path / "sweep.yaml"
    path.write_text(yaml.safe_dump({"placement": "line", **keys}))
    with refused((str(path), key, "")):
        read_sweep(path)


def test_the_old_key_works_in_a_search(tmp_path, caplog):
    by = {"by": "recall", "judge": "pretrained"}
    path = write_search(tmp_path, verify={"set": {"judge": "finetuned"}})
    content = yaml.safe_load(path.read_text())
    path.write_text(yaml.safe_dump(content | {"search": content["search"] | {"objective": by}}))
    file = check(SearchFile, read_named(path, [], SearchFile), path)
    assert file.search.objective[0].name == "pretrained.recall"
    assert file.verify.set == {"evaluator": "finetuned"}
    assert len(caplog.messages) == 1


def test_run_folders_with_the_old_name_are_read(tmp_path):
    folder = write_run(tmp_path / "run", NAMES, seeds=(1,), evaluators=("generalist", "specialist"))
    new = RunFolder.read(folder)
    for path in folder.glob("*.parquet"):
        pd.read_parquet(path).rename(columns={"evaluator": "judge"}).to_parquet(path)
    text = (folder / "sweep.json").read_text()
    about = json.loads(text.replace('"evaluator"', '"judge"'))
    (folder / "sweep.json").write_text(json.dumps(about | {"pictured": {"judge": "generalist"}}))
    (folder / "config.yaml").write_text("grid: {judge: [generalist]}")
    old = RunFolder.read(folder)
    assert old.axes == new.axes == ("evaluator",)
    assert old.sweep.pictured == {"evaluator": "generalist"}
    for name in ("results", "trials", "surrogates", "left_out"):
        pd.testing.assert_frame_equal(getattr(old, name), getattr(new, name))
    assert [own.evaluator for own in groups(old)] == [own.evaluator for own in groups(new)]
    assert value_at(old.config, "grid", "evaluator") == ["generalist"]
