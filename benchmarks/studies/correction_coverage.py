"""Are fitted corrections right on average, and do their intervals hold the truth?

    python benchmarks/studies/correction_coverage.py              # 1,000 logs of each case
    python benchmarks/studies/correction_coverage.py --times 40

Logs of known factors of three classes, half of the tracks of the first. A track is in 1 to 19
frames at one distance, give or take 3 m. Its boxes have Poisson numbers of simulated rays, of mean
1, 3 or 8, or as many as a LiDAR of 32 beams sends to a car (60,000 / distance²), times a lognormal
number of the track; real rays are another such draw. Each ray returns by itself, or tracks differ:
the factor of each is from a beta distribution whose correlation of rays is 0.2. In half of the
cases returns are lost with a distance of 85 m.

Printed: the mean of every fitted number as a share of the truth, of the distance the mean of its
inverse, in 1/km; and the percent of the 95 % intervals that hold the truth.
"""

from itertools import product
from typing import Annotated

import numpy as np
import typer

from lidarplace.validation.fit import FitData

FACTORS = {"Car": 0.62, "Pedestrian": 0.90, "Cyclist": 0.45}
RAYS = {"1": 1.0, "3": 3.0, "8": 8.0, "as 32 beams": None}


def drawn(
    random: np.random.Generator, tracks: int, mean_rays: float | None, alike: float, loss: float
) -> FitData:
    """Draw the counts of a log."""
    class_of = np.resize([0, 1, 0, 2], tracks)
    track = np.repeat(np.arange(tracks), random.integers(1, 20, tracks))
    away = random.uniform(8.0, 70.0, tracks)[track] + random.normal(0.0, 3.0, len(track))
    away = np.clip(away, 4.0, 75.0)
    mean = (mean_rays or 60_000 / away**2) * random.lognormal(0.0, 0.5, tracks)[track]
    share = np.array(list(FACTORS.values()))[class_of]
    if alike:
        share = random.beta(share * (1 / alike - 1), (1 - share) * (1 / alike - 1))
    real = random.binomial(random.poisson(mean), share[track] * np.exp(-loss * away))
    counts = real.astype(np.float64), away, np.arange(len(real))
    name = np.array(list(FACTORS))[class_of[track]]
    return FitData(track, name, *counts, random.poisson(mean).astype(np.float64), away)


def main(times: Annotated[int, typer.Option(help="logs of each case")] = 1000) -> None:
    """Print a line for each case."""
    for loss, alike, (label, mean_rays), tracks in product(
        (0.0, 1 / 85), (0.0, 0.2), RAYS.items(), (40, 60, 250)
    ):
        random, truth = np.random.default_rng(0), [*FACTORS.values(), loss]
        numbers, held = [], []
        for _ in range(times):
            data = drawn(random, tracks, mean_rays, alike, loss)
            fitted, ends = data.fit(), data.intervals()
            numbers.append([*(fitted.factor[n] for n in FACTORS), 1 / (fitted.distance or np.inf)])
            near, far = ends["distance"]
            pairs = [*(ends[name] for name in FACTORS), (1 / far, 1 / near)]
            held.append([low <= x <= high for x, (low, high) in zip(truth, pairs, strict=True)])
        mean = np.mean(numbers, axis=0)
        shares = " ".join(f"{100 * m / t:4.0f}" for m, t in zip(mean[:3], truth[:3], strict=True))
        covered = " ".join(f"{x:5.1f}" for x in 100 * np.mean(held, axis=0))
        print(
            f"distance {1 / loss if loss else np.inf:3.0f} m, alike {alike}, rays {label:>11}, "
            f"{tracks:3} tracks: mean % {shares}, loss {1000 * mean[3]:5.2f}; covered {covered}",
            flush=True,
        )


if __name__ == "__main__":
    typer.run(main)
