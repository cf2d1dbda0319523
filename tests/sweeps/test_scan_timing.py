"""LiDARs with rate_hz: what needs motion is refused at planning, what has none warns."""

import pandas as pd
import pytest
import yaml
from typer.testing import CliRunner

from lidarplace.rigs.scan_timing import STILL_WORLD
from sweeps.commands.requirements import app
from sweeps.configuration.file import ConfigError
from sweeps.results.rig_cautions import rig_cautions
from sweeps.search.output.terminal import warnings_of
from sweeps.search.problem.problem import read_problem
from tests.sweeps.search_files import SEARCH, write_search
from tests.sweeps.small_log import write_small_log
from tests.sweeps.test_plan import plan_of, stages

TIMED = {"azimuth_steps": 360, "rate_hz": 10}


def test_a_log_without_motion_is_refused_at_planning(tmp_path):
    write_small_log(tmp_path / "log")
    keys = {"scene": {"source": "log", "folder": str(tmp_path / "log")}, "classes": ["Car"]}
    assert stages(plan_of(tmp_path, **keys))["collect"] == 2
    with pytest.raises(ConfigError, match=r"^scene\.folder: .*ego_yaw: missing column; a LiDAR"):
        plan_of(tmp_path, **keys, lidar=TIMED)
    with pytest.raises(ConfigError, match="missing column"):
        plan_of(tmp_path, **keys, grid={"lidar.rate_hz": [None, 10]})
    frames = pd.read_parquet(tmp_path / "log/frames.parquet")
    posed = frames.assign(ego_x=frames["timestamp_s"], ego_y=0.0, ego_yaw=0.0)
    posed.to_parquet(tmp_path / "log/frames.parquet")
    assert stages(plan_of(tmp_path, **keys, lidar=TIMED))["collect"] == 2


def test_sweeps_whose_surrogates_see_a_still_world_warn(tmp_path):
    write_small_log(tmp_path / "log")
    scene = {"source": "log", "folder": str(tmp_path / "log")}
    keys = {"scene": scene, "classes": ["Car"], "detector": None}
    assert STILL_WORLD in rig_cautions(plan_of(tmp_path, **keys, lidar=TIMED))
    assert STILL_WORLD not in rig_cautions(plan_of(tmp_path, **keys))


def test_searches_warn(tmp_path):
    timed, still = SEARCH["lidar"] | {"rate_hz": 10}, SEARCH["lidar"]
    for lidar in (timed, still):
        problem = read_problem(write_search(tmp_path, lidar=lidar), [])
        assert (STILL_WORLD in warnings_of(problem)) == (lidar is timed)


def test_requirements_warn(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    need = {"name": "near", "where": {"distance": [1, 2]}, "what": "Pedestrian", "step": 1.0}
    mounts = {"mine": {"mounts": [{"z": 1.8}]}}
    for rate in (10, None):
        keys = {"lidar": {"beams": 4, "azimuth_steps": 90, "rate_hz": rate}, "placements": mounts}
        keys["requirements"] = [need | {"at_least": {"points": 1}}]
        (tmp_path / "needs.yaml").write_text(yaml.safe_dump(keys))
        result = CliRunner().invoke(app, ["needs.yaml"], env={"COLUMNS": "400"})
        assert result.exit_code in (0, 1), result.output
        assert ("world that stands still" in " ".join(result.stderr.split())) == bool(rate)
