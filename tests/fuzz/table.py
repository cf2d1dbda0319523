"""Counts of outcomes."""

from collections import Counter
from collections.abc import Sequence

from tests.fuzz.cases import Result
from tests.fuzz.judge import DONE, REFUSED


def table(results: Sequence[Result]) -> str:
    """Text: rows of targets, columns of outcomes, faults last."""
    counts = Counter((result.target, result.outcome.kind) for result in results)
    faults = sorted({kind for _, kind in counts} - {DONE, REFUSED})
    kinds = [DONE, REFUSED, *faults]
    names = list(dict.fromkeys(result.target for result in results))
    lines = [["", *kinds]]
    lines += [[name, *(str(counts[name, kind] or "") for kind in kinds)] for name in names]
    lines.append(["all", *(str(sum(counts[name, kind] for name in names)) for kind in kinds)])
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    padded = (
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True))
        for line in lines
    )
    return "\n".join(line.rstrip() for line in padded)
