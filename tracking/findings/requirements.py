"""Which requirements the rigs of a sweep meet, each in its worst case."""

from collections.abc import Mapping

import pandas as pd

from lidarplace.requirements.tables import worst_cases
from tracking.findings.groups import at
from tracking.run_folders.sweep import RunFolder


def verdicts(run: RunFolder, setting: Mapping[str, object]) -> pd.DataFrame:
    """The worst case of each requirement under each placement at one setting of the axes.

    Rows of `lidarplace.requirements.tables.worst_cases` behind the placement; none if nothing was
    required.
    """
    cases = run.requirements
    if cases is None or cases.empty:
        return pd.DataFrame(columns=["placement", "requirement", "met"])
    return worst_cases(at(cases, setting), ["placement"])


def met(verdicts: pd.DataFrame) -> pd.Series:
    """How many requirements each placement meets, by its name, such as "3 of 5"."""
    by_rig = verdicts.groupby("placement", sort=False)["met"]
    return by_rig.sum().astype(str) + " of " + by_rig.size().astype(str)
