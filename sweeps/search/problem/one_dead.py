"""A rig with any one of its LiDARs dead: what an objective is then, at worst."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from sweeps.configuration.search import ObjectiveSettings
from sweeps.search.problem.choice import Choices

WHOLE = ""
"""The case in which all LiDARs work."""


def with_each_dead(rig: Choices) -> list[Choices]:
    """The rig with a dead LiDAR, by its place; none of a single one, which leaves nothing.

    A dead LiDAR hides what is behind it as before.
    """
    if len(rig) < 2:
        return []
    return [
        (*rig[:number], replace(dead, dead=True), *rig[number + 1 :])
        for number, dead in enumerate(rig)
    ]


def cases_of(rig: Choices, objectives: Sequence[ObjectiveSettings]) -> dict[str, Choices]:
    """What objectives look at, by the end of a name: the rig, and it with any LiDAR dead."""
    cases = {WHOLE: rig} if not all(o.one_lidar_dead for o in objectives) else {}
    if any(o.one_lidar_dead for o in objectives):
        left = enumerate(with_each_dead(rig), start=1)
        cases |= {f"_without_{number}": own for number, own in left}
    return cases


def worst_case(objective: ObjectiveSettings, values: Mapping[str, float]) -> str | None:
    """The case of `cases_of` that decides an objective; None where nothing is left of the rig."""
    if not objective.one_lidar_dead:
        return WHOLE
    dead = {case: value for case, value in values.items() if case != WHOLE}
    return min(dead, key=lambda case: dead[case]) if dead else None


def value_of(objective: ObjectiveSettings, values: Mapping[str, float]) -> float:
    """What an objective is, by its values in the cases; nothing finds nothing."""
    case = worst_case(objective, values)
    return 0.0 if case is None else values[case]
