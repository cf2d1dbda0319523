"""What MLflow tells of a search beside its trials: a text, and columns."""

from sweeps.search.problem.problem import Problem

ABOUT = """\
A search for a LiDAR placement: one parent run, and a child run for every trial.

- Metrics: the objectives by their names; `feasible` is 1 where all constraints are kept;
  `violation.NAME` is by how much a constraint is missed, 0 or less where it is kept; `seconds`.
- Parameters: where each LiDAR sits, `lidar_1.x_m` and so on, and the values of `search.space`.
- A trial on top that is not feasible is no answer: filter by ``metrics.feasible = 1``.
- The parent run has the command, the configuration, the report and the tables. The best trials
  are evaluated again with all rays: `search.json` and the report have those values.
"""
"""What the experiment's page tells, Markdown."""


def columns(problem: Problem) -> list[str]:
    """What the experiment's page shows of every trial; the first objective orders them."""
    objectives = [objective.name for objective in problem.file.search.objective]
    violations = [f"violation.{limit.name}" for limit in problem.question.constraints]
    metrics = [f"metrics.{name}" for name in (*objectives, "feasible", *violations)]
    return [*metrics, *(f"params.{path}" for path in problem.file.search.space), "metrics.seconds"]
