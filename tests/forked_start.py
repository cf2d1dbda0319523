"""Imported by the process that `tests.forked` forks: the sources behind the keys are read once."""

from lidarplace.base.registry import _entry_points
from sweeps.tasks.stages import FUNCTIONS
from sweeps.tasks.task import code_of

for _stage in FUNCTIONS:
    code_of(_stage, "pointpillars_tiny")
    code_of(_stage)
_entry_points.cache_clear()  # a command may have plug-ins
