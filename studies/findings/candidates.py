"""Writes `candidates.yaml`: rigs at random, of which `design.py` takes those that differ most.

Run as `python studies/findings/candidates.py`, then `lidarplace run
studies/findings/candidates.yaml`: surrogates alone, no detector.
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import yaml

from lidarplace import PAPER_PLACEMENTS, Placement
from lidarplace.mounting.random_rigs import random_rigs

FOLDER = Path(__file__).parent
CANDIDATES = 160
SEED = 200
"""Of the candidates; generalists draw their rigs with the seeds of their trainings."""


def main() -> None:
    """Write the file beside this one."""
    rigs = random_rigs(list(PAPER_PLACEMENTS.values()), CANDIDATES, SEED)
    settings = yaml.safe_load((FOLDER / "base.yaml").read_text(encoding="utf-8"))
    settings["detector"] = None
    settings["placements"] = {rig.name: {"mounts": mounts_of(rig)} for rig in rigs}
    settings["grid"] = {"placement": [rig.name for rig in rigs]}
    write(settings, FOLDER / "candidates.yaml", "python studies/findings/candidates.py")


def mounts_of(rig: Placement) -> list[dict[str, float]]:
    """The mounts as a configuration has them, to a millimetre and a milliradian."""
    return [{key: round(value, 3) for key, value in asdict(mount).items()} for mount in rig.mounts]


def write(settings: object, path: Path, command: str) -> None:
    """A configuration whose first line says what made it."""
    content = yaml.safe_dump(settings, sort_keys=False, width=100, default_flow_style=None)
    path.write_text(f"# Made by `{command}`.\n{content}", encoding="utf-8")


if __name__ == "__main__":
    main()
