"""Imported by the process that `tests.forked` forks: the sources behind the keys are read once."""

from lidarplace.base import registry
from sweeps.tasks.XXX import FUNCTIONS
from sweeps.tasks.XXX import code_of

for _stage in FUNCTIONS:
    code_of(_stage, "pointpillars_tiny")
    code_of(_stage)
registry._entry_points.cache_clear()  # a command may have plug-ins
