"""Poles of a junction by three rules, and by chance: recall for the same number of LiDARs.

    python benchmarks/studies/roadside.py runs/roadside

Candidates are poles along the kerbs of one junction of simulated traffic. *Objective* chooses them
one after the other by expected recall, *gain* by perceptual gain after Jiang et al., "Optimizing
the Placement of Roadside LiDARs for Autonomous Driving" (ICCV 2023): the pole with the largest gain
of what a learnt predictor expects of a detector. Their predictor is a network that reads a point
cloud; here it is a logistic curve of each class, found or not by the number of points on an object,
fitted to the detections of a detector under random poles. *Corners* are poles at the corners of the
junction, opposite ones first, *random* the mean of several draws.

A detector trained on other random poles evaluates all of them on traffic of its own. Prints its
recall of all objects, percent, and the difference to *objective*, with 95 % intervals of the
jackknife over routes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
import typer
import yaml
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.spatial.distance import cdist
from scipy.stats import t

from lidarplace import Mount, Placement, Roi
from lidarplace.base.errors import InputError
from lidarplace.configuration.sensor import SensorSettings
from lidarplace.logs.box_log import join_logs
from lidarplace.logs.boxes import CLASSES
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.recall.expected_recall import ExpectedRecall
from lidarplace.recall.surface_cells import SurfaceCells
from lidarplace.scenes.kinds import obstacles_around, scene_parts
from lidarplace.scenes.site import Obstacles, Site
from lidarplace.scenes.sumo.settings import SumoScene
from sweeps.commands.run import run

SCENE: dict[str, Any] = {"seed": 1, "density": 120, "frames_per_route": 8, "frame_stride": 40}
SCENE |= {"routes": 10, "test_routes": 8}
SIDE_M, HEIGHT_M, APART_M, KERB_M = 24.0, 5.0, 6.0, 2.5
MODEL, SHARE, MOST, DRAWS = "pandar40p", 0.2, 4, 2
RULES = ("objective", "gain", "corners")


def kerbs(around: Obstacles) -> NDArray[np.float64]:
    """Places for poles: near a lane, on none and in no building, `APART_M` apart, shape (n, 2)."""
    steps = np.arange(1.0 - SIDE_M, SIDE_M, 1.0)
    places: list[tuple[float, float]] = []
    near_kerb = Obstacles(around.buildings, around.lanes + np.array([0, 0, 0, KERB_M, KERB_M]))
    for x, y in sorted(((x, y) for x in steps for y in steps), key=lambda at: math.hypot(*at)):
        if places and cdist([(x, y)], places).min() < APART_M:
            continue
        if _fits(around, x, y) and not _fits(near_kerb, x, y):
            places.append((x, y))
    return np.array(places)


def _fits(around: Obstacles, x: float, y: float) -> bool:
    try:
        around.check_place(np.array([x, y, 3.0]), "a pole")
    except InputError:
        return False
    return True


def greedy(seen: list[SurfaceCells], value: Any) -> list[int]:
    """Choose `MOST` candidates, each with the largest gain of `value` of the cells."""
    chosen: list[int] = []
    cells = SurfaceCells.none(len(seen[0].points))
    while len(chosen) < MOST:
        gains = [-1.0 if i in chosen else value(cells.and_(new)) for i, new in enumerate(seen)]
        chosen.append(int(np.argmax(gains)))
        cells = cells.and_(seen[chosen[-1]])
    return chosen


def corners(places: NDArray[np.float64]) -> list[int]:
    """The poles nearest to the corners of a square, opposite ones first."""
    ends = np.array([(1, 1), (-1, -1), (-1, 1), (1, -1)]) * 7.0
    return cdist(ends, places).argmin(axis=1).tolist()


def evaluated(folder: Path, name: str, sets: dict[str, list[int]], test_seed: int) -> pd.DataFrame:
    """Objects of the test traffic: whether a generalist found them, by placement."""
    places = np.array(yaml.safe_load((folder / "places.yaml").read_text()))
    placements = {
        key: {
            "mounts": [dict(zip("xyz", (*places[i].tolist(), HEIGHT_M), strict=True)) for i in of]
        }
        for key, of in sets.items()
    }
    trained = [key for key in sets if key.startswith("trained")]
    config = {
        "site": {},
        "scene": SCENE | {"test_seed": test_seed},
        "roi": {"x": [-SIDE_M, SIDE_M], "y": [-SIDE_M, SIDE_M], "z": [0, 4]},
        "lidar": {"name": MODEL, "cloud_share": SHARE},
        "surrogate": {"resolution": 0.8, "names": ["s_mig"], "accuracy": False}
        | {"sampling_error": False},
        "evaluator": "generalist",
        "training": {"checkpoint": "pretrained"},
        "generalist": {"rigs": trained, "rigs_per_frame": 2, "epochs": 2},
        "placements": placements,
        "grid": {"placement": [key for key in sets if key not in trained]},
        "output": str(folder),
        "ray": "debug",
    }
    file = folder / f"{name}.yaml"
    file.write_text(yaml.safe_dump(config))
    run(file)
    found, trials = (pd.read_parquet(folder / name / f"{n}.parquet") for n in ("found", "trials"))
    objects = pd.read_parquet(folder / name / "objects.parquet")
    return found.merge(trials[["trial", "placement"]]).merge(objects)


def predictor(objects: pd.DataFrame) -> dict[str, NDArray[np.float64]]:
    """Fit the chance that an object is found, a logistic curve of ln(1 + points), by class."""
    curves = {}
    for name, of_class in objects.groupby("class"):
        x, y = np.log1p(of_class["points"].to_numpy()), of_class["found"].to_numpy(bool)

        curves[str(name)] = minimize(_loss, np.zeros(2), args=(x, np.where(y, 1, -1))).x
    return curves


def _loss(w: NDArray[np.float64], x: NDArray[np.float64], side: NDArray[np.int64]) -> float:
    return float(np.logaddexp(0, -side * (w[0] + w[1] * x)).mean() + 1e-3 * (w**2).sum())


def by_route(objects: pd.DataFrame, names: list[str]) -> NDArray[np.float64]:
    """Recall of all objects without each route in turn, and at last with all, percent."""
    rows = objects[objects["placement"].isin(names)]
    sums = rows.groupby("route")["found"].agg(["sum", "count"])
    left, whole = sums.sum() - sums, sums.sum()
    return 100 * np.append(left["sum"] / left["count"], whole["sum"] / whole["count"])


def interval(values: NDArray[np.float64]) -> str:
    """Format a jackknife: the value of all and its 95 % interval."""
    without, whole, n = values[:-1], values[-1], len(values) - 1
    error = math.sqrt((n - 1) / n * ((without - without.mean()) ** 2).sum())
    half = t.ppf(0.975, n - 1) * error
    return f"{whole:.1f} ({whole - half:.1f} to {whole + half:.1f})"


def main(folder: Annotated[Path, typer.Argument(help="folder for runs and the store")]) -> None:
    """Choose poles, evaluate them and print the table."""
    folder.mkdir(parents=True, exist_ok=True)
    site, scene, random = Site(), SumoScene(**SCENE), np.random.default_rng(0)
    places = kerbs(obstacles_around(scene, site))
    (folder / "places.yaml").write_text(yaml.safe_dump(places.tolist()))
    numbers = [*range(1, MOST + 1)] * 4
    draws = [random.permutation(len(places))[:number].tolist() for number in numbers]
    trained = {f"trained_{i}": draw for i, draw in enumerate(draws[:10])}
    predicted = {f"predictor_{i}": draw for i, draw in enumerate(draws[10:15])}
    curves = predictor(evaluated(folder, "predictor", trained | predicted, 101))

    lidar = SensorSettings(name=MODEL).lidar().thinned(SHARE)
    candidates = [
        Placement(f"{i}", [Mount(at[0], at[1], HEIGHT_M)], lidar) for i, at in enumerate(places)
    ]
    log = scene_parts(scene.model_copy(update={"seed": 1, "test_seed": 202}), site)
    choice = join_logs([part.recording.record() for part in log if "test" in part.splits])
    roi = Roi((-SIDE_M, SIDE_M), (-SIDE_M, SIDE_M), (0, 4), 0.8)
    nothing = Vehicle("nothing", np.empty((0, 2, 3)))
    model = ExpectedRecall.from_log(choice, roi, CLASSES, vehicle=nothing)
    seen = model.objects.seen_by(candidates)
    weights = np.array([curves[name] for name in model.objects.table["class"]])
    chosen = {
        "objective": greedy(seen, lambda cells: model.probabilities(cells).sum()),
        "gain": greedy(
            seen,
            lambda cells: (
                1 / (1 + np.exp(-weights[:, 0] - weights[:, 1] * np.log1p(cells.points)))
            ).sum(),
        ),
        "corners": corners(places),
    }
    sets = {f"{rule}_{n}": chosen[rule][:n] for rule in RULES for n in range(1, MOST + 1)}
    for d in range(DRAWS):
        order = random.permutation(len(places)).tolist()
        sets |= {f"random_{n}_{d}": order[:n] for n in range(1, MOST + 1)}
    objects = evaluated(folder, "chosen", trained | sets, 303)
    typer.echo(f"{len(places)} candidates; predictor {curves}")
    for rule, of in chosen.items():
        typer.echo(f"{rule}: {[tuple(places[i]) for i in of]}")
    for n in range(1, MOST + 1):
        ours = by_route(objects, [f"objective_{n}"])
        line = [f"{n}", interval(ours)]
        for rule in ("gain", "corners", "random"):
            names = [name for name in sets if name.startswith(f"{rule}_{n}")]
            line.append(f"{interval(by_route(objects, names) - ours)}")
        typer.echo(" | ".join(line))


if __name__ == "__main__":
    typer.run(main)
