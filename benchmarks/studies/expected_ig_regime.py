"""What `expected_ig` measures at a q, a number of azimuth steps and a resolution.

    lidarplace record examples/grid.yaml logs
    python benchmarks/studies/expected_ig_regime.py logs/sumo-1

A voxel that m rays cross is detected with d = 1 - (1 - q)^m. Where q m is small everywhere, d is
q m and `expected_ig` is a sum over rays, as `expected_points` is; where it is large, d is 1 and it
is `covered_entropy`. The table says for the paper's eight placements, cars, in the front half:

    of h_pog    mean share of the entropy of the POG
    spread      (highest - lowest) / lowest over the placements
    linear      mean `linear_share`: 100 % if every ray counts by itself
    rho         Spearman's with covered_entropy and with expected_points
    best        the first three placements
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import pandas as pd
from rich.console import Console
from rich.table import Table

from lidarplace import PAPER_PLACEMENTS, Lidar, OccupancyGrid, Placement, Roi, evaluate
from lidarplace.logs.box_log import read_box_log
from lidarplace.pog.surrogates.evaluate import expected_ig_of_rays, linear_share


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("log", type=Path, help="a box log, as lidarplace record writes it")
    parser.add_argument("--resolution", type=float, nargs="+", default=[0.1, 0.2, 0.4])
    parser.add_argument("--azimuth-steps", type=int, nargs="+", default=[900, 1800, 5625])
    parser.add_argument("--q", type=float, nargs="+", default=[0.02, 0.1, 0.3])
    args = parser.parse_args()
    log = read_box_log(args.log)
    frames = log.frames.loc[log.frames["split"] == "train", "frame"]
    boxes = log.boxes[log.boxes["frame"].isin(frames)]
    table = Table("m", "steps", "q", "of h_pog", "spread", "linear", "rho cov.", "rho pts", "best")
    for resolution in args.resolution:
        roi = Roi((0, 40), (-20, 20), (0, 4), resolution)
        grid = OccupancyGrid.from_boxes(boxes, roi, "Car", len(frames))
        for steps in args.azimuth_steps:
            lidar = replace(Lidar.paper(), azimuth_steps=steps)
            rows = {
                name: _row(grid, p.with_lidar(lidar), args.q)
                for name, p in PAPER_PLACEMENTS.items()
            }
            values = pd.DataFrame(rows).T
            for q in args.q:
                own = values[q]
                rank = values[[q, "covered", "points"]].corr("spearman").loc[q]
                table.add_row(
                    f"{resolution:g}",
                    f"{steps}",
                    f"{q:g}",
                    f"{own.mean() / grid.h_pog:.0%}",
                    f"{own.max() / own.min() - 1:.1%}",
                    f"{values[f'linear {q}'].mean():.0%}",
                    f"{rank['covered']:+.2f}",
                    f"{rank['points']:+.2f}",
                    ", ".join(own.sort_values(ascending=False).index[:3]),
                )
    Console(width=120).print(table)


def _row(grid: OccupancyGrid, placement: Placement, q: list[float]) -> dict[float | str, float]:
    grids = {"Car": grid}
    found = evaluate(grid, placement, surrogates=["expected_points"])
    return (
        {value: expected_ig_of_rays(grids, placement, value)["Car"] for value in q}
        | {f"linear {value}": linear_share(grids, placement, value)["Car"] for value in q}
        | {"covered": found.covered_entropy, "points": found.expected_points}
    )


if __name__ == "__main__":
    main()
