"""Tables of a search's run folder."""

from collections.abc import Iterable
from dataclasses import replace

from tracking.run_folders.sweep_tables import REQUIREMENTS as OF_SWEEPS
from tracking.run_folders.table_schema import Column, TableSchema

_RIG = Column("rig", "str", "its name")
_BOUNDS = ("low", "high")
_VALUE = Column("value.OBJECTIVE", "float64", "as the search computes it")
_VIOLATION = Column(
    "violation.CONSTRAINT", "float64", "in the constraint's unit; kept if 0 or less"
)
TRIALS = TableSchema.of(
    "trials",
    "a trial",
    Column("number", "int64", "from 0"),
    Column("state", "str", "Optuna's: `COMPLETE`, `PRUNED` or `FAIL`"),
    Column("feasible", "bool", "whether every constraint is kept"),
    Column("possible", "bool", "whether no two LiDARs sit in one place"),
    _VALUE,
    _VIOLATION,
    Column("enough.requirement.NAME", "float64", "share of positions with enough", needed=False),
    Column("seconds", "float64", "of the evaluation, s"),
    Column("failure", "str", "why it has no value", needed=False),
    Column("lidars", "int64", "how many the rig has", needed=False),
    Column("lidar_N.model", "str", "of LiDAR N, from 1", needed=False),
    Column("lidar_N.zone", "str", "where it sits; empty where it is fixed", needed=False),
    Column("lidar_N.x_m", "float64", "m; and `y_m`, `z_m`", needed=False),
    Column("lidar_N.roll_deg", "float64", "degrees; and `pitch_deg`, `yaw_deg`", needed=False),
    needed=True,
)
"""Trials of a search, with capitals for what depends on the search, see `trials_of`."""
BOUND = TableSchema.of(
    "bound",
    "a step of the upper bound",
    Column("seconds", "float64", "since it was begun, s"),
    Column("bound", "float64", "of the first objective"),
    Column("kind", "str", "what gave it"),
)
GREEDY = TableSchema.of(
    "greedy",
    "a step of greedy choice, with columns of the LiDARs as `trials` has them",
    Column("step", "int64", "from 1"),
    Column("gain", "float64", "of the objective"),
    Column("value", "float64", "after the step"),
)
ROBUSTNESS = TableSchema.of(
    "robustness",
    "an objective of a rig in one case",
    _RIG,
    Column("case", "str", "`as designed`, mounts that are off, a LiDAR that fails, a scene"),
    Column("objective", "str", "its name"),
    Column("draws", "int64", "of the case"),
    Column("value", "float64", "mean over the draws"),
    Column("worst", "float64", "of the draws"),
    Column("share", "float64", "the value by that of the rig as designed"),
    key=("rig", "case", "objective"),
)
VERIFIED = TableSchema.of(
    "verified",
    "a metric of a rig that detectors were trained for",
    _RIG,
    Column("role", "str", "`found`, `greedy` or `paper`"),
    Column("class", "str", "object class; `all` for all objects"),
    Column("metric", "str", "as in a sweep's results"),
    Column("iou", "float64", "the least overlap of a detection that counts; 0: of no single one"),
    Column("value", "float64", "mean over seeds, percent"),
    *(Column(bound, "float64", "of its 95 % interval") for bound in _BOUNDS),
    Column("seeds", "int64", "that have a value"),
    Column("difference", "float64", "to the best of the paper's eight, by seed"),
    *(Column(f"difference_{bound}", "float64", "of its 95 % interval") for bound in _BOUNDS),
    Column("surrogate", "float64", "the first objective; missing where that is measured"),
)

CHOSEN = replace(
    VERIFIED,
    name="chosen",
    doc="a metric of a rig that the generalist judged on traffic that the search did not see; "
    "columns as `verified`, and in `surrogate` the objective value of the search",
)

REQUIREMENTS = replace(
    OF_SWEEPS,
    doc="a requirement under a rig in one case, as built first",
    columns=(_RIG, *OF_SWEEPS.columns[1:]),
    axes=(),
)

TABLES = (TRIALS, BOUND, GREEDY, ROBUSTNESS, REQUIREMENTS, CHOSEN, VERIFIED)  # all of them


def trials_of(objectives: Iterable[str], constraints: Iterable[str]) -> TableSchema:
    """Make `TRIALS` with a value of each objective and a violation of each constraint."""
    values = [replace(_VALUE, name=f"value.{name}") for name in objectives]
    violations = [replace(_VIOLATION, name=f"violation.{name}") for name in constraints]
    at = TRIALS.columns.index(_VALUE)
    before, after = TRIALS.columns[:at], TRIALS.columns[at + 2 :]
    return replace(TRIALS, columns=(*before, *values, *violations, *after))
