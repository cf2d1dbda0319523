"""`python -m tracking.report RUN`: build the report again from the run folder alone."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from tracking.report.build import build_report


def main(words: Sequence[str] | None = None) -> int:
    """Run with the arguments `words`, by default those of the command line.

    Prints the report's path and returns 0, or one line of error and returns 2.
    """
    parser = argparse.ArgumentParser(prog="python -m tracking.report", description=__doc__)
    parser.add_argument("run", type=Path, help="folder that a sweep has left, runs/NAME")
    arguments = parser.parse_args(words)
    try:
        print(build_report(arguments.run))
    except ValueError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
