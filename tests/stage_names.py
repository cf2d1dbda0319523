"""The stages of the package."""

import importlib
import pkgutil

from sweeps import stages
from sweeps.stages.stage import Stage


def stage_modules() -> dict[str, str]:
    """Files of stages: their name, and their module."""
    names = [module.name for module in pkgutil.iter_modules(stages.__path__)]
    return {name: f"{stages.__name__}.{name}" for name in names if name not in ("stage", "task")}


def stage_names() -> set[str]:
    """Names of all stages."""
    modules = map(importlib.import_module, stage_modules().values())
    kinds = [kind for module in modules for kind in vars(module).values() if isinstance(kind, type)]
    return {kind.name for kind in kinds if issubclass(kind, Stage) and hasattr(kind, "name")}
