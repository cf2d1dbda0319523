"""Files of sweeps and of searches, for commands that take both."""

from collections.abc import Sequence
from pathlib import Path

from lidarplace.configuration.yaml import YamlError, read_yaml_file
from sweeps.configuration.grid import Sweep, read_sweep


def is_search(path: Path) -> bool:
    """Return whether a file describes a search. Mistakes in a file are reported by its reader."""
    try:
        content = read_yaml_file(path)
    except (OSError, YamlError):
        return False
    return isinstance(content, dict) and "search" in content


def read_either(path: Path, overrides: Sequence[str] = ()) -> Sweep:
    """Return the sweep of a file; of a search one with its scene, store and output.

    Raises ConfigError."""
    if not is_search(path):
        return read_sweep(path, overrides)
    from sweeps.search.problem.problem import read_problem  # Optuna

    return read_problem(path, overrides).sweep()
