"""A log in another convention is noticed before any work, wherever it is the scene."""

from dataclasses import replace

import numpy as np
import pytest

from lidarplace.logs.box_log import write_box_log
from sweeps.configuration.file import ConfigError
from sweeps.plan.plan import read_plan
from sweeps.search.output.terminal import warnings_of
from sweeps.search.problem.problem import read_problem
from tests.fuzz.conventions import CONVENTIONS, right_log
from tests.sweeps.search_files import write_search
from tests.sweeps.small_log import write_sweep

TILTED = 0.35  # metres off the ground, as of a rear axle: implausible, but not impossible


def lifted(log):
    return replace(log, boxes=log.boxes.assign(z=log.boxes["z"] + TILTED))


def test_plan_and_search(tmp_path):
    right, wrong = right_log(5), CONVENTIONS["half sizes"]
    for log, said in ((right, []), (lifted(right), [f"{TILTED:+.2f} m off the ground"])):
        write_box_log(tmp_path / "log", log)
        scene = {"source": "log", "folder": str(tmp_path / "log")}
        _, plan = read_plan(write_sweep(tmp_path, placement="line"))
        search = warnings_of(read_problem(write_search(tmp_path, scene=scene)))
        assert len(plan.cautions) == len(said)
        for text in said:
            assert text in plan.cautions[0]
            assert any(text in warning for warning in search)
    write_box_log(tmp_path / "log", wrong(right))
    for read, path in ((read_plan, "grid.yaml"), (read_problem, "small.yaml")):
        with pytest.raises(ConfigError) as caught:
            read(tmp_path / path)
        assert caught.value.key == "scene"
        assert "as of half sizes" in str(caught.value)


@pytest.mark.parametrize("same", [True, False])
def test_a_test_log_of_training_routes(tmp_path, same):
    """Its frames have other numbers and its boxes other names and another order."""
    log = right_log(5)
    boxes = log.boxes.sample(frac=1, random_state=1, ignore_index=True)
    boxes["object_id"] += " again"
    if not same:
        boxes["x"] += np.random.default_rng(0).normal(size=len(boxes), scale=1e-3)
    write_box_log(tmp_path / "log", log)
    frames = log.frames.assign(split="test")
    write_box_log(tmp_path / "tests", replace(log, boxes=boxes, frames=frames))
    scene = {
        "source": "log",
        "folder": str(tmp_path / "log"),
        "test_folder": str(tmp_path / "tests"),
    }
    path = write_sweep(tmp_path, placement="line", scene=scene)
    if not same:
        assert read_plan(path)[1].cautions == ()
        return
    with pytest.raises(
        ConfigError, match="30 of 40 test frames have all boxes of a training frame"
    ):
        read_plan(path)
