"""Imported by the process that `tests.forked` forks: the sources behind the keys are read once."""

from lidarplace.base.code_version import code_version
from lidarplace.base.registry import _entry_points

code_version("sweeps.plan.plan", "training.detectors.pointpillars")
_entry_points.cache_clear()  # a command may have plug-ins
