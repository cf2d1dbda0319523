"""Random placements of four LiDARs, for benchmarks of whole sweeps."""

from __future__ import annotations

from typing import Any

import numpy as np

LOW, HIGH = (-1.0, -0.7, 1.6, -0.3, -0.3), (1.0, 0.7, 2.2, 0.3, 0.3)
KEYS = ("x", "y", "z", "roll", "pitch")


def random_placements(number: int) -> dict[str, Any]:
    """`placements:` of a configuration; the same for the same number."""
    rows = np.random.default_rng(0).uniform(LOW, HIGH, (number, 4, len(KEYS))).round(3)
    return {
        f"p{i:04d}": {"mounts": [dict(zip(KEYS, row, strict=True)) for row in mounts]}
        for i, mounts in enumerate(rows.tolist())
    }
