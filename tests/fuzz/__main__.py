"""Counts of outcomes: `python -m tests.fuzz GROUP|NAME [COUNT [SEED [NUMBER]]]`.

GROUP is data, detections, maps, reports, settings, lines, classes or plugins; NAME one of its
targets, a verb of `lines`, a key of `classes` or a kind of plug-in. NUMBER runs this case alone and
prints all of it.
"""

import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from tests.fuzz.cases import Result, run_case, run_cases, table
from tests.fuzz.classes import PLACES, run_class
from tests.fuzz.lines import LINES, run_line
from tests.fuzz.plugins import RIGHT, run_plugin
from tests.fuzz.targets import DATA, DETECTIONS, MAPS, REPORTS, SETTINGS
from tests.fuzz.world import write_world

GROUPS = {
    "data": DATA,
    "detections": DETECTIONS,
    "maps": MAPS,
    "reports": REPORTS,
    "settings": SETTINGS,
}
FURTHER: dict[str, tuple[Callable[..., Result], Iterable[str]]] = {
    "lines": (run_line, LINES),
    "classes": (run_class, PLACES),
    "plugins": (run_plugin, RIGHT),
}
"""Groups whose cases have runners of their own, and the names of what these take."""


def results_of(
    named: str, count: int, seed: int, number: int | None, folder: Path
) -> Iterator[Result]:
    """The cases that are asked for, after the world is written into `folder`."""
    world, place = folder / "world", folder / "cases"
    write_world(world)
    every = [target for group in GROUPS.values() for target in group]
    targets = GROUPS.get(named) or [target for target in every if target.name == named]
    chosen: list[tuple[Callable[..., Result], list[Any], Path]] = [(run_case, targets, place)]
    for group, (runner, names) in FURTHER.items():
        chosen_names = [name for name in names if named in (group, f"{group} {name}")]
        chosen.append((runner, chosen_names, place / group))
    for runner, chosen_names, where in chosen:
        if number is None:
            yield from run_cases(runner, chosen_names, seed, count, world, where)
        else:
            yield from (runner(name, seed, number, world, where) for name in chosen_names)


def main(named: str, count: str = "20", seed: str = "0", number: str | None = None) -> None:
    only = None if number is None else int(number)
    results = []
    with tempfile.TemporaryDirectory() as folder:
        for result in results_of(named, int(count), int(seed), only, Path(folder)):
            results.append(result)
            if result.outcome.fault or number is not None:
                print(result, flush=True)
    print(table(results))


if __name__ == "__main__":
    main(*sys.argv[1:])
