"""What `--dry-run --json` of a search says."""

from dataclasses import asdict
from typing import Any

from sweeps.search.greedy.certificate import why_none
from sweeps.search.output.terminal import warnings_of
from sweeps.search.problem.problem import Problem


def planned(problem: Problem) -> dict[str, Any]:
    """What a search would do: what is varied, wanted and kept, and how it looks for it."""
    settings, space = problem.file.search, problem.space
    return {
        "name": problem.file.name,
        "lidars": list(space.numbers),
        "zones": list(settings.zones),
        "parameters": list(space.distributions(space.makeups[-1]) | space.further),
        "objectives": [{"name": o.name, "best": o.best} for o in settings.objective],
        "judged_on": [dict(changes) for changes in problem.tests.search] if problem.judged else [],
        "over": settings.over,
        "constraints": [asdict(constraint) for constraint in problem.question.constraints],
        "no_bound": why_none(problem),
        "trials": settings.trials,
        "sampler": settings.sampler,
        "batch_size": settings.batch_size,
        "seed": settings.seed,
        "warnings": warnings_of(problem),
    }
