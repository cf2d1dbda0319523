"""Writes `controlled.yaml`: rigs that differ from one another in one thing alone.

Evaluated by generalists, with exact mounts and with angles that are off. Run as
`python studies/findings/controlled.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import yaml
from candidates import FOLDER, write

SPACING = 2.0
"""Between beams, degrees."""
SQUARE = ((0.4, 0.5), (0.4, -0.5), (-0.4, 0.5), (-0.4, -0.5))
HEIGHT = 2.4


def main() -> None:
    """Write the file beside this one."""
    settings = yaml.safe_load((FOLDER / "base.yaml").read_text(encoding="utf-8"))
    rigs = {name: {"mounts": mounts} for name, mounts in _rigs(settings["lidar"]).items()}
    settings |= {
        "detector": "pointpillars_tiny",
        "evaluator": "generalist",
        "training": {"epochs": 6, "rotation": 0.1},
        "generalist": {"rigs": 32, "rigs_per_frame": 8, "epochs": 4},
        "placements": rigs,
        "grid": {"placement": list(rigs), "mounting_errors.angle_deg": [0.0, 0.5], "seed": [1, 2]},
    }
    write(settings, FOLDER / "controlled.yaml", "python studies/findings/controlled.py")


def _rigs(lidar: dict[str, Any]) -> dict[str, list[dict[str, Any]]]:
    side = [1, -1, 1, -1]
    # The share of the clouds is one for all models.
    model = {key: value for key, value in lidar.items() if key != "cloud_share"}
    line = [(0.0, y) for y in (0.5, -0.5)]
    rigs = {
        "base": _rig(),
        "level": _rig(pitches=[0.0] * 4),
        "stacked": _rig(pitches=[0.0] * 4, heights=[2.1, 2.3, 2.5, 2.7]),
        "height_2.1": _rig(heights=[2.1] * 4),
        "height_2.7": _rig(heights=[2.7] * 4),
        "height_3.0": _rig(heights=[3.0] * 4),
        "roof_front": _rig([(0.85, y) for y in (0.3, 0.1, -0.1, -0.3)], heights=[1.6] * 4),
        "roof_rear": _rig([(-1.45, y) for y in (0.3, 0.1, -0.1, -0.3)], heights=[1.6] * 4),
        "close": _rig([(x / 4, y / 4) for x, y in SQUARE]),
        "rolled_+10": _rig(rolls=[10.0 * one for one in side]),
        "rolled_-10": _rig(rolls=[-10.0 * one for one in side]),
        "pitched_+3": _rig(pitches=[p + 3 for p in _even(4)]),
        "pitched_-3": _rig(pitches=[p - 3 for p in _even(4)]),
        "one": _rig([(0.0, 0.0)]),
        "two": _rig(line),
        "three": _rig([*line, (0.4, 0.0)]),
        "six": _rig([*SQUARE, *line]),
        "eight": _rig([*SQUARE, *line, (0.4, 0.0), (-0.4, 0.0)]),
    }
    for name, places in (("one_of_64", [(0.0, 0.0)]), ("two_of_32", line)):
        beams = 64 // len(places)
        spacing = np.ptp(lidar["elevation_deg"]) / (beams - 1)
        pitches = _even(len(places), float(spacing))
        rigs[name] = [
            mount | {"lidar": model | {"beams": beams}} for mount in _rig(places, pitches=pitches)
        ]
    return rigs


def _rig(
    places: Sequence[tuple[float, float]] = SQUARE,
    *,
    heights: Sequence[float] | None = None,
    rolls: Sequence[float] | None = None,
    pitches: Sequence[float] | None = None,
) -> list[dict[str, Any]]:
    """Interleaved, level and at HEIGHT unless it is said otherwise; angles in degrees."""
    number = len(places)
    columns = zip(
        places,
        heights or [HEIGHT] * number,
        rolls or [0.0] * number,
        pitches or _even(number),
        strict=True,
    )
    return [
        {"x": x, "y": y, "z": z, "roll_deg": roll, "pitch_deg": pitch}
        for (x, y), z, roll, pitch in columns
    ]


def _even(number: int, spacing: float = SPACING) -> list[float]:
    """Pitches that put the beams of so many LiDARs at equal distances, degrees."""
    return [round(((i + 0.5) / number - 0.5) * spacing, 3) for i in range(number)]


if __name__ == "__main__":
    main()
