"""Seconds by stage, and parallel efficiency."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from tracking.report.analysis import Analysis
from tracking.report.sections.where_time_went import stage_times, where_time_went
from tracking.run_folders.sweep import RunFolder


@pytest.fixture
def tasks():
    """Two stages that overlap by a second, and a result that was there before."""
    rows = [
        ("pog", 1.0, 4.0, 1.5, 2e8),
        ("pog", 1.0, 3.0, 1.0, 3e8),
        ("train", 3.0, 11.0, 8.0, np.nan),
        ("train", np.nan, np.nan, 5.0, np.nan),
    ]
    columns = ["stage", "started", "ended", "seconds", "peak_memory"]
    return pd.DataFrame(rows, columns=columns)


def test_stages_have_their_own_seconds_from_first_start_to_last_end(tasks):
    table = stage_times(tasks).set_index("stage")
    assert table.loc["pog"].tolist() == [2, 2.5, 3, (1.5 + 1) / 2, 3e8]
    assert table.loc["train"].tolist()[:4] == [1, 8, 8, 0]
    assert stage_times(tasks.iloc[3:]).empty


def test_idle_time_counts_for_the_efficiency_of_the_whole(made_up_run, tasks):
    run = RunFolder.read(made_up_run)
    own = replace(run, tasks=tasks.assign(cached=tasks["started"].isna(), node=""))
    said = where_time_went(Analysis(own)).notes[1]
    work = f"3 tasks did {10.5:,.0f} s of work on 2 cores in 11 s"
    assert said.startswith(f"{work}: parallel efficiency {10.5 / 22:.2f}, ")
