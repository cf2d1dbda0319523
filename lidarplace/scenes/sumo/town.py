"""A generated town: a bent grid of streets with sidewalks, crossings and bike lanes."""

import contextlib
import io
import subprocess
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lidarplace.base.optional import needs

JUNCTIONS = (4, 3)
"""Junctions along x and y: some 1.5 km of street, so an ego meets about five of 80 vehicles."""
BLOCK_M = (80.0, 105.0)
"""Shortest and longest distance of neighbouring junctions before they are shifted."""
SHIFT_M = 9.0
"""Standard deviation of a junction's shift along x and y; bends the grid, so yaws vary."""
SPEED_M_S = 11.0  # speed limit, 40 km/h


class TownMap(NamedTuple):
    """A SUMO network of a town."""

    path: Path
    lefthand: bool = False  # whether vehicles keep left in the network
    mirrored: bool = False  # whether it is the mirror image, y for -y, of a town that keeps left


def sumo_home() -> Path:
    """Return the folder of the installed Eclipse SUMO; raise ImportError without it."""
    try:
        with contextlib.redirect_stdout(io.StringIO()):  # libsumo greets with a remark on pyarrow
            import libsumo  # noqa: F401
        import sumo
        import sumolib  # noqa: F401
    except ModuleNotFoundError as error:
        problem = needs(error) or f"needs the package {error.name}"
        raise ModuleNotFoundError(f"simulated traffic {problem}", name=error.name) from error
    return Path(sumo.SUMO_HOME)


def build_town(seed: int, folder: Path) -> Path:
    """Generate the town of `seed` and return the SUMO network file in `folder`.

    Every junction has at least two arms, so no street is a dead end. Raises ImportError without
    SUMO, RuntimeError with netgenerate's message."""
    home = sumo_home()
    rng = np.random.default_rng(seed)
    length_x, length_y = rng.uniform(*BLOCK_M, size=2)
    shift = f"normc(0,{SHIFT_M:g},{-2 * SHIFT_M:g},{2 * SHIFT_M:g})"
    network = folder / "town.net.xml"
    command = [
        *(str(home / "bin" / "netgenerate"), "--grid", "--output-file", str(network)),
        *("--seed", str(rng.integers(2**31 - 1))),
        *("--grid.x-number", str(JUNCTIONS[0]), "--grid.y-number", str(JUNCTIONS[1])),
        *("--grid.x-length", f"{length_x:.2f}", "--grid.y-length", f"{length_y:.2f}"),
        *("--perturb-x", shift, "--perturb-y", shift),
        *("--default.lanenumber", "2", "--random-lanenumber"),
        *("--default.speed", f"{SPEED_M_S:g}", "--no-turnarounds"),
        *("--default.junctions.type", "traffic_light", "--tls.default-type", "actuated"),
        *("--sidewalks.guess", "--crossings.guess", "--bikelanes.guess"),
        *("--default.bikelane-width", "1.5"),
        *("--xml-validation", "never", "--no-warnings"),
    ]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    if result.returncode != 0:
        raise RuntimeError(f"netgenerate failed: {result.stderr.strip()}")
    return network
