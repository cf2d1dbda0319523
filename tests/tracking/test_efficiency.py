"""Parallel efficiency: the clock is shared out exactly, and nothing of it is lost."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tracking.report.sections.where_time_went import WHOLE_SWEEP, stage_efficiency

STAGES = ("pog", "surrogates", "train")
TASK = st.tuples(st.sampled_from(STAGES), st.integers(0, 40), st.integers(0, 12))


def _tasks(rows: list[tuple[str, float, float]], work: float = 1.0) -> pd.DataFrame:
    """Tasks from (stage, start, length); they worked for a share `work` of their time."""
    table = pd.DataFrame(rows, columns=["stage", "started", "length"])
    table["ended"] = table["started"] + table["length"]
    table["seconds"] = work * table.pop("length")
    return table.assign(peak_memory=np.nan).astype({"started": float, "ended": float})


def _wall(table: pd.DataFrame) -> dict[str, float]:
    return table[table["stage"] != WHOLE_SWEEP].set_index("stage")["wall"].to_dict()


def test_a_stage_alone_has_the_usual_formula():
    rows = [("pog", 0.0, 4.0), ("pog", 0.0, 3.0), ("train", 5.0, 8.0), ("train", 5.0, 8.0)]
    table = stage_efficiency(_tasks(rows, work=0.5), cores=2).set_index("stage")
    assert table.loc["pog", ["tasks", "task_seconds", "wall"]].tolist() == [2, 3.5, 4]
    assert table.loc["pog", "efficiency"] == 3.5 / (4 * 2)
    assert table.loc["train", "efficiency"] == 0.5
    assert table.loc["train", "overhead"] == 4
    # The whole includes the second in which nothing ran, the stages do not.
    whole = table.loc[WHOLE_SWEEP]
    assert (whole["tasks"], whole["wall"]) == (4, 13)
    assert whole["efficiency"] == pytest.approx(11.5 / 26)


def test_idle_time_before_the_first_task_counts_for_the_whole():
    table = stage_efficiency(_tasks([("pog", 6.0, 2.0)]), cores=1).set_index("stage")
    assert (table.loc["pog", "efficiency"], table.loc[WHOLE_SWEEP, "efficiency"]) == (1, 0.25)


def test_stages_side_by_side_share_the_clock_by_their_tasks():
    rows = [("pog", 0.0, 10.0), ("train", 0.0, 10.0), ("train", 0.0, 10.0), ("train", 0.0, 5.0)]
    # Five seconds as 1 : 3 and five as 1 : 2.
    expected = {"pog": 5 / 4 + 5 / 3, "train": 15 / 4 + 10 / 3}
    assert _wall(stage_efficiency(_tasks(rows), cores=4)) == pytest.approx(expected)


@given(st.lists(TASK, min_size=1, max_size=30))
def test_walls_are_those_of_a_fine_grid_of_time(rows):
    tasks = _tasks(rows)
    own = _wall(stage_efficiency(tasks, cores=1))
    # Whole seconds: within one of them nothing changes, so the grid is exact.
    middle = np.arange(60)[:, None] + 0.5
    running = (tasks["started"].to_numpy() < middle) & (middle < tasks["ended"].to_numpy())
    stage = tasks["stage"].to_numpy(dtype=object)
    for name in own:
        share = running[:, stage == name].sum(axis=1) / np.maximum(running.sum(axis=1), 1)
        assert own[name] == pytest.approx(share.sum())
    assert sum(own.values()) == pytest.approx(running.any(axis=1).sum())


@given(st.lists(TASK, min_size=1, max_size=30), st.floats(0, 1))
def test_efficiency_is_at_most_one_on_as_many_cores_as_ran(rows, work):
    tasks = _tasks(rows, work)
    starts, ends = tasks["started"].to_numpy(), tasks["ended"].to_numpy()
    most = max(int(((starts <= t) & (t < ends)).sum()) for t in starts)
    table = stage_efficiency(tasks, max(most, 1))
    assert (table["efficiency"].dropna() <= 1 + 1e-12).all()
    assert (table["overhead"] >= -1e-12).all()


def test_tasks_that_were_there_before_do_not_count():
    tasks = _tasks([("pog", 0.0, 1.0), ("train", 0.0, 1.0)])
    tasks.loc[tasks["stage"] == "train", ["started", "ended"]] = np.nan
    assert stage_efficiency(tasks, 2)["stage"].tolist() == ["pog", WHOLE_SWEEP]
    assert stage_efficiency(tasks.iloc[1:], 2).empty


def test_the_largest_memory_is_reported():
    tasks = _tasks([("pog", 0.0, 1.0), ("pog", 0.0, 1.0)]).assign(peak_memory=[2e8, 3e8])
    assert (stage_efficiency(tasks, 2)["peak_memory"] == 3e8).all()


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match=r"stage pog started at 3.0 s and ended at 1.0 s"):
        stage_efficiency(_tasks([("pog", 3.0, -2.0)]), 1)
