"""Rigs of a search as points of a sweep that a generalist judges."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sweeps.plan.plan import Plan, make_plan
from sweeps.search.problem.as_sweep import placement_settings, sweep_of, sweep_settings
from sweeps.search.problem.choice import Choices
from sweeps.search.problem.problem import Problem


def judged_plan(problem: Problem, rigs: Mapping[str, Choices], traffic: Mapping[str, Any]) -> Plan:
    """The plan that judges rigs by the generalists of the search.

    Args:
        rigs: by the name that their placements get.
        traffic: key path -> value: what the test traffic is, beside the configuration.
    """
    file = problem.file
    config = sweep_settings(problem.source, file, rigs, file.name)
    settings = file.generalist
    if isinstance(settings.rigs, int):
        own = {name: placement_settings(rig, file) for name, rig in problem.training_rigs.items()}
        config["placements"] = own | config["placements"]
        settings = settings.model_copy(update={"rigs": tuple(own)})
    config["generalist"] = settings.model_dump(mode="json")
    changes = {"judge": "generalist", **traffic}
    values: dict[str, dict[str, Any]] = {name: {} for name in rigs}
    return make_plan(sweep_of(config, problem.path, values, file.search.seeds, changes))
