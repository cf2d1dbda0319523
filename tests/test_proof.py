"""The contrast of studies/proof: its intervals hold, and the README quotes it."""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

ROOT = Path(__file__).parents[1]
SEEDS, TESTS, ROUTES = 12, ("a", "b", "c"), 30


@pytest.fixture(scope="module", autouse=True)
def _scripts_of_the_study():
    sys.path.insert(0, str(ROOT / "studies" / "proof"))
    yield
    sys.path.remove(str(ROOT / "studies" / "proof"))


def drawn(random: np.random.Generator, gain: float, of_seed: float, of_route: float):
    """Rows as `contrast` wants them: each seed and each route shifts what the rig gains."""
    rows = []
    by_seed = gain + of_seed * random.normal(size=SEEDS)
    for test in TESTS:
        routes = of_route * random.normal(size=ROUTES)
        without = (routes.sum() - routes) / (ROUTES - 1)
        luck = random.normal(size=SEEDS)  # of seeds, for both rigs alike
        for rig, sign in (("found", 1.0), ("center", 0.0)):
            values = 70 + luck + sign * (by_seed + routes.mean())
            rows += [(test, rig, seed, "", "", 0, v) for seed, v in enumerate(values)]
            left = 70 + sign * (gain + without)
            rows += [(test, rig, 0, "route", str(r), 1, v) for r, v in enumerate(left)]
    names = ["test", "placement", "seed", "unit", "left_out", "ground_truths", "value"]
    return pd.DataFrame(rows, columns=names)


@pytest.mark.parametrize(("of_seed", "of_route"), [(1.5, 0.5), (0.5, 5.0)])
def test_intervals_of_the_contrast_hold_the_truth(of_seed, of_route):
    from contrast import contrast

    random = np.random.default_rng(0)
    held = []
    for _ in range(150):
        difference, half, seeds = contrast(
            drawn(random, 1.0, of_seed, of_route), ("found", "center"), list(TESTS)
        )
        assert seeds == SEEDS
        held.append(abs(difference - 1.0) <= half)
    assert 0.91 <= np.mean(held) <= 0.99


def test_the_readme_quotes_the_contrast():
    from contrast import gain

    readme = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    low, high = gain("finetuned", "Car AP over IoU").split(" ", 1)
    assert f"{low.lstrip('+')} points {high.replace('+', '')}" in readme
