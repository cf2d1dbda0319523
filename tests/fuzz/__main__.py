"""Counts of outcomes by target: `python -m tests.fuzz [COUNT [SEED [TARGET [NUMBER]]]]`."""

from __future__ import annotations

import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from tests.fuzz.cases import Result, run_case, run_cases
from tests.fuzz.lines import LINES, run_line, run_lines
from tests.fuzz.targets import DATA, MAPS, REPORTS, SETTINGS
from tests.fuzz.world import write_world

GROUPS = {"data": DATA, "maps": MAPS, "reports": REPORTS, "settings": SETTINGS}


def table(results: list[Result]) -> str:
    """Rows of targets, columns of outcomes."""
    counts = Counter((result.target, result.outcome.kind) for result in results)
    kinds = sorted(
        {kind for _, kind in counts}, key=lambda kind: (kind not in ("done", "refused"), kind)
    )
    names = list(dict.fromkeys(result.target for result in results))
    lines = [["", *kinds]] + [
        [name, *(str(counts[name, kind] or "") for kind in kinds)] for name in names
    ]
    lines.append(["all", *(str(sum(counts[name, kind] for name in names)) for kind in kinds)])
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in lines
    )


def main(count: int = 20, seed: int = 0, named: str = "data", number: int | None = None) -> None:
    lines = (
        list(LINES)
        if named == "lines"
        else [named.removeprefix("lines ")] * named.startswith("lines ")
    )
    targets = (
        []
        if lines
        else GROUPS.get(named) or [t for group in GROUPS.values() for t in group if t.name == named]
    )
    with tempfile.TemporaryDirectory() as folder:
        world = Path(folder) / "world"
        write_world(world)
        if number is not None:
            case = Path(folder) / "case"
            print(
                run_line(lines[0], seed, number, world, case)
                if lines
                else run_case(targets[0], seed, number, world, case)
            )
            return
        results = []
        for target in targets:
            start = time.monotonic()
            results += run_cases([target], seed, count, world, Path(folder) / "cases")
            print(
                f"{target.name}: {len(results)} {time.monotonic() - start:.1f} s", file=sys.stderr
            )
        for name in lines:
            start = time.monotonic()
            results += run_lines([name], seed, count, world, Path(folder) / "cases")
            print(f"{name}: {time.monotonic() - start:.1f} s", file=sys.stderr)
    for result in results:
        if result.outcome.fault:
            lines = result.outcome.told.strip().splitlines() or [""]
            print(
                f"{result.target} {result.case}: {result.what}: "
                f"{result.outcome.kind}: {lines[-1][:300]}"
            )
    print(table(results))


if __name__ == "__main__":
    words = sys.argv[1:]
    main(*(int(word) if word.isdecimal() else word for word in words))
