"""A stage from outside of the package: its class, and a line of the plan."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import pandas as pd

from lidarplace import Mount
from lidarplace.logs.box_log import BoxLog
from sweeps.configuration.grid import read_sweep
from sweeps.execution.schedule import Schedule
from sweeps.plan import plan as planning
from sweeps.stages.stage import Stage, training_log
from tests.sweeps.small_log import write_sweep
from tests.sweeps.toy import ran


@dataclass(frozen=True)
class Nearest:
    """Distance of the nearest object to the highest LiDAR, by frame."""

    table: pd.DataFrame


@dataclass(frozen=True)
class NearestStage(Stage[Nearest]):
    """Measure how near objects come."""

    mounts: Annotated[tuple[Mount, ...], "placement"]

    name = "nearest"
    order = 95
    tables: ClassVar = {"table": "nearest"}

    def run(self, *logs: BoxLog) -> Nearest:
        boxes = training_log(logs).boxes
        highest = max(self.mounts, key=lambda mount: mount.z)
        distance = (boxes["x"] - highest.x).pow(2).add((boxes["y"] - highest.y).pow(2)).pow(0.5)
        return Nearest(distance.groupby(boxes["frame"]).min().rename("m").reset_index())


def plan_nearest(planning, grid_point, logs):
    return planning.add_for(grid_point, NearestStage(tuple(grid_point.rig.mounts)), logs)


def test_a_stage_is_a_file_and_a_line_of_the_plan(tmp_path, monkeypatch):
    monkeypatch.setattr(planning, "STUDIES", (*planning.STUDIES, plan_nearest))
    grid = {"placement": ["center", "line"], "lidar.range": [50.0, 60.0]}
    sweep = read_sweep(write_sweep(tmp_path, "small.yaml", detector=None, grid=grid))
    plan, store, folder = ran(sweep, tmp_path)
    tasks = [task for task in plan.tasks if task.stage.name == "nearest"]
    assert [task.label for task in tasks] == ["center", "line"], "the LiDAR does not decide it"
    assert store.load(tasks[0]).table["m"].gt(0).all()
    written = pd.read_parquet(folder / "nearest.parquet")
    assert list(written.columns) == ["placement", "lidar.range", "frame", "m"]
    assert len(written) == 4 * len(store.load(tasks[0]).table)
    scene = {task.key for task in tasks[0].inputs}
    ready = Schedule(plan.tasks, scene | {trial.pog.key for trial in plan.trials})
    order = [ready.next().stage.name for _ in range(5)]
    assert order == ["surrogates"] * 4 + ["nearest"]
