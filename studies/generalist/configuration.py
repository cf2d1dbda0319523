"""Writes `study.yaml`: the sweep of `examples/generalist.yaml` with 24 further rigs at random.

Run as `python studies/generalist/configuration.py`.
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import yaml

from lidarplace import PAPER_PLACEMENTS
from lidarplace.mounting.random_rigs import random_rigs

RIGS = 24
SEED = 100
"""Of the rigs that are judged; generalists draw theirs with the seeds of their trainings."""


def main() -> None:
    """Write the file beside this one."""
    root = Path(__file__).parents[2]
    text = (root / "examples" / "generalist.yaml").read_text(encoding="utf-8")
    settings = yaml.safe_load(text)
    rigs = {}
    for rig in random_rigs(list(PAPER_PLACEMENTS.values()), RIGS, SEED):
        mounts = [
            {key: round(value, 3) for key, value in asdict(mount).items()} for mount in rig.mounts
        ]
        rigs[rig.name.replace("rig", "random")] = {"mounts": mounts}
    settings["placements"] = rigs
    settings["grid"]["placement"] += list(rigs)
    settings["surrogate"] = {"accuracy": False, "sampling_error": False}
    head = "# Made by `python studies/generalist/configuration.py`.\n"
    path = Path(__file__).with_name("study.yaml")
    content = yaml.safe_dump(settings, sort_keys=False, width=100, default_flow_style=None)
    path.write_text(head + content, encoding="utf-8")


if __name__ == "__main__":
    main()
