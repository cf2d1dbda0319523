"""Counts of outcomes: `python -m tests.fuzz GROUP|NAME [COUNT [SEED [NUMBER]]]`.

GROUP is data, detections, maps, reports, settings, lines or plugins; NAME one of its targets, a
verb of `lines` or a kind of plug-in. NUMBER runs this case alone and prints all of it.
"""

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from tests.fuzz.cases import Result, run_case, run_cases, table
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


def results_of(
    named: str, count: int, seed: int, number: int | None, folder: Path
) -> Iterator[Result]:
    """The cases that are asked for, after the world is written into `folder`."""
    world, place = folder / "world", folder / "cases"
    write_world(world)
    every = [target for group in GROUPS.values() for target in group]
    targets = GROUPS.get(named) or [target for target in every if target.name == named]
    verbs = [verb for verb in LINES if named in ("lines", f"lines {verb}")]
    kinds = [kind for kind in RIGHT if named in ("plugins", f"plugins {kind}")]
    if number is None:
        yield from run_cases(run_case, targets, seed, count, world, place)
        yield from run_cases(run_line, verbs, seed, count, world, place / "lines")
        yield from run_cases(run_plugin, kinds, seed, count, world, place / "plugins")
    else:
        yield from (run_case(target, seed, number, world, place) for target in targets)
        yield from (run_line(verb, seed, number, world, place) for verb in verbs)
        yield from (run_plugin(kind, seed, number, world, place) for kind in kinds)


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
