"""Poles of junctions by several rules, and by chance: recall for the same number of LiDARs.

    python benchmarks/studies/roadside.py runs/roadside

Candidates are poles along the kerbs of one junction in each of three towns. In traffic of their own
(12 routes of 8 frames) all rules but *corners* (opposite ones first) and *random* (mean of 4 draws)
add the pole that raises most the sum of the probabilities that objects are found:

- *objective*: `expected_recall`, with the detection curves of vehicles;
- *gain*: perceptual gain after Jiang et al., "Optimizing the Placement of Roadside LiDARs for
  Autonomous Driving" (ICCV 2023): a network predicts perception from the cloud of a frame;
- *points*: a logistic curve of each class, of ln(1 + points on the object).

Plan, written before the results. A generalist, fine-tuned on 10 random sets of poles, evaluates
all. Network and curve are fitted to its detections under 40 other random sets, and validated on 12
further ones in other traffic. The rules meet in traffic that none of them saw. The primary contrast
is the mean over 1 to 4 LiDARs of *gain* less *objective*, in all towns: a rule is better if the
95 % interval excludes 0. Intervals are of the jackknife over the routes of all towns; they hold for
these junctions and trainings. Specialists, fine-tuned for each set of 2 and 4 LiDARs by
*objective*, *gain* and *corners* with as many frames and two seeds, repeat it. Time is of one core,
with casting, without trainings."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
import torch
import typer
import yaml
from numpy.typing import NDArray
from perception_predictor import PerceptionPredictor, Pillars, joined, pillars_of
from scipy.optimize import minimize
from scipy.spatial.distance import cdist
from scipy.stats import rankdata, t

from lidarplace import Mount, Placement, Roi
from lidarplace.base.errors import InputError
from lidarplace.clouds.collect import SimulatedClouds, crop_for
from lidarplace.clouds.surroundings import Surroundings
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

TOWNS = (1, 2, 3)
SCENE: dict[str, Any] = {"density": 120, "frames_per_route": 8, "frame_stride": 40}
SCENE |= {"routes": 10, "test_routes": 12}
SIDE_M, HEIGHT_M, APART_M, KERB_M = 24.0, 5.0, 6.0, 2.5
MODEL, SHARE, MOST = "pandar40p", 0.2, 4
TRAINED, FITTED, HELD_OUT, DRAWS = 10, 40, 12, 4  # random sets
FIT_SEED, CHOICE_SEED, TEST_SEED, HELD_OUT_SEED = 101, 202, 303, 404
RULES = ("objective", "gain", "points", "corners", "random")
BY_SPECIALISTS = ("objective", "gain", "corners")
NOTHING, SIDE = Vehicle("nothing", np.empty((0, 2, 3))), (-SIDE_M, SIDE_M)
ROUGH = {"accuracy": False, "sampling_error": False}
Rig = Sequence[int]


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


def greedy(seen: Sequence[Any], both: Callable[[Any, Any], Any], value: Any) -> list[int]:
    """Choose `MOST` candidates, each with the largest sum of `value` of what the rig sees."""
    chosen: list[int] = []
    while len(chosen) < MOST:
        rigs = [[*chosen, i] for i in range(len(seen)) if i not in chosen]
        sums = [value(reduce(both, [seen[i] for i in rig])).sum() for rig in rigs]
        chosen = rigs[int(np.argmax(sums))]
    return chosen


def corners(places: NDArray[np.float64]) -> list[int]:
    """The poles nearest to the corners of a square, opposite ones first."""
    ends = np.array([(1, 1), (-1, -1), (-1, 1), (1, -1)]) * 7.0
    return cdist(ends, places).argmin(axis=1).tolist()


@dataclass(frozen=True)
class Junction:
    """The junction of one town: folder of its runs, seed, candidates and rigs by name."""

    folder: Path
    town: int
    places: NDArray[np.float64]
    trained: dict[str, Rig]

    def at(self, rig: Rig) -> list[list[float]]:
        """Return x and y of some of the candidates."""
        return self.places[list(rig)].tolist()

    def placement(self, rig: Rig) -> Placement:
        """Return LiDARs at some of the candidates, thinned as in a run."""
        mounts = [Mount(x, y, HEIGHT_M) for x, y in self.at(rig)]
        return Placement(str(rig), mounts, SensorSettings(name=MODEL).lidar().thinned(SHARE))

    def evaluated(self, name: str, rigs: dict[str, Rig], test_seed: int, **keys: Any) -> Any:
        """Objects of the test traffic by rig: whether the detector found them, a table.

        That is the generalist, unless keys of a sweep say otherwise."""
        placements = {}
        for key, rig in (rigs if keys else self.trained | rigs).items():
            mounts = [dict(zip("xyz", (*at, HEIGHT_M), strict=True)) for at in self.at(rig)]
            placements[key] = {"mounts": mounts}
        generalist = {"rigs": list(self.trained), "rigs_per_frame": 2, "epochs": 2}
        config: dict[str, Any] = {
            "site": {},
            "scene": SCENE | {"seed": self.town, "test_seed": test_seed},
            "roi": {"x": list(SIDE), "y": list(SIDE), "z": [0, 4]},
            "lidar": {"name": MODEL, "cloud_share": SHARE},
            "surrogate": {"names": ["s_mig"], "resolution": 0.8} | ROUGH,
            "training": {"checkpoint": "pretrained", "epochs": 4},
            "evaluator": "generalist",
            "generalist": generalist,
            "placements": placements,
            "grid": {"placement": list(rigs)},
            "output": str(self.folder),
            "ray": "debug",
        }
        file = self.folder / f"{name}.yaml"
        file.write_text(yaml.safe_dump(config | keys))
        run(file)
        tables = (self.folder / name / f"{n}.parquet" for n in ("found", "trials", "objects"))
        found, trials, objects = map(pd.read_parquet, tables)
        rows = found.merge(trials[["trial", "placement", "seed"]]).merge(objects)
        return rows.assign(town=self.town, route=f"{self.town}/" + rows["route"].astype(str))

    def traffic(self, test_seed: int) -> Surroundings:
        """Simulate the test traffic of a run."""
        scene = SumoScene(**SCENE, seed=self.town, test_seed=test_seed)
        tests = [part for part in scene_parts(scene, Site()) if "test" in part.splits]
        return Surroundings(join_logs([part.recording.record() for part in tests]), self.town)

    def pillars(self, traffic: Surroundings, objects: pd.DataFrame, rig: Rig) -> Pillars:
        """Cast the clouds of a rig and sort them around objects."""
        placement, frames = self.placement(rig), np.unique(objects["frame"])
        subject = traffic, frames, placement, crop_for(SIDE, SIDE, (0, 4), placement), self.town
        return pillars_of(SimulatedClouds(*subject, vehicle=NOTHING), objects)

    def detections(
        self, name: str, rigs: dict[str, Rig], test_seed: int
    ) -> tuple[Pillars, pd.DataFrame]:
        """Return objects that the generalist found or not, and the pillars around them."""
        rows = self.evaluated(name, rigs, test_seed).sort_values("placement", kind="stable")
        traffic = self.traffic(test_seed)
        parts = [self.pillars(traffic, of, rigs[key]) for key, of in rows.groupby("placement")]
        return np.concatenate(parts), rows

    def choose(self, network: Any, curves: Any) -> dict[str, list[int]]:
        """Return and print the choice of each rule, with its seconds of processor time."""
        traffic, number = self.traffic(CHOICE_SEED), len(self.places)
        roi = Roi(SIDE, SIDE, (0, 4), 0.8)
        model = ExpectedRecall.from_log(traffic.log, roi, CLASSES, vehicle=NOTHING)
        objects = model.objects.table

        def by_cells(value: Callable[[SurfaceCells], NDArray[np.float64]]) -> list[int]:
            seen = model.objects.seen_by([self.placement([i]) for i in range(number)])
            return greedy(seen, SurfaceCells.and_, value)

        def by_network() -> list[int]:
            seen = [self.pillars(traffic, objects, [i]) for i in range(number)]
            return greedy(seen, joined, lambda both: network.probabilities(both, objects))

        rules: dict[str, Callable[[], list[int]]] = {
            "objective": lambda: by_cells(model.probabilities),
            "gain": by_network,
            "points": lambda: by_cells(lambda cells: by_curve(curves, objects, cells.points)),
            "corners": lambda: corners(self.places),
        }
        chosen = {}
        for rule, choice in rules.items():
            start = time.process_time()
            chosen[rule] = choice()
            poles, seconds = self.at(chosen[rule]), time.process_time() - start
            typer.echo(f"town {self.town}: {rule}: {poles} of {number}, {seconds:.1f} s")
        return chosen


def curves_of(rows: pd.DataFrame) -> dict[Any, NDArray[np.float64]]:
    """Fit the chance that an object is found, a logistic curve of ln(1 + points), by class."""

    def loss(w: NDArray[np.float64], x: NDArray[np.float64], side: NDArray[np.int64]) -> float:
        return float(np.logaddexp(0, -side * (w[0] + w[1] * x)).mean() + 1e-3 * (w**2).sum())

    return {
        name: minimize(loss, [0, 0], (np.log1p(of["points"]), np.where(of["found"], 1, -1))).x
        for name, of in rows.groupby("class")
    }


def by_curve(curves: Any, objects: pd.DataFrame, points: Any) -> NDArray[np.float64]:
    """Return the probability that objects are found by the points on them."""
    weights = np.array([curves[name] for name in objects["class"]])
    return 1 / (1 + np.exp(-weights[:, 0] - weights[:, 1] * np.log1p(np.asarray(points))))


def by_route(rows: pd.DataFrame, value: str = "found") -> NDArray[np.float64]:
    """Mean of a column without each route in turn, and at last with all."""
    sums = rows.groupby("route")[value].agg(["sum", "count"])
    left, whole = sums.sum() - sums, sums.sum()
    return np.append(left["sum"] / left["count"], whole["sum"] / whole["count"])


def interval(values: NDArray[np.float64], digits: int = 1) -> str:
    """Format a jackknife: the value of all and its 95 % interval."""
    without, whole, n = values[:-1], values[-1], len(values) - 1
    error = math.sqrt((n - 1) / n * ((without - without.mean()) ** 2).sum())
    half = t.ppf(0.975, n - 1) * error
    return f"{whole:.{digits}f} ({whole - half:.{digits}f} to {whole + half:.{digits}f})"


def print_recalls(title: str, rows: pd.DataFrame, rules: Sequence[str]) -> None:
    """Print recall of the first rule, percent, and the others less that, by number of LiDARs."""
    typer.echo(f"{title} | {' | '.join(rules)}")
    rule, number = (rows["placement"].str.split("_").str[part] for part in (0, 1))
    for n in [*sorted(number.unique()), "mean"]:
        of_number = number.eq(n) | (n == "mean")
        recalls = [100 * by_route(rows[of_number & rule.eq(name)]) for name in rules]
        others = [interval(recall - recalls[0]) for recall in recalls[1:]]
        typer.echo(" | ".join([n, interval(recalls[0]), *others]))


def print_validation(rows: pd.DataFrame) -> None:
    """Print log loss, area under the ROC curve and error of a set's recall of each predictor."""
    found, losses = rows["found"], {}
    for name in ("network", "curve", "base_rate"):
        p = rows[name].clip(1e-6, 1 - 1e-6)
        losses[name] = by_route(rows.assign(loss=-np.log(np.where(found, p, 1 - p))), "loss")
        above = rankdata(p)[found].sum() - found.sum() * (found.sum() + 1) / 2
        sets = rows.groupby(["town", "placement"])[[name, "found"]].mean()
        line = [name, interval(losses[name], 3), interval(losses[name] - losses["network"], 3)]
        line += [f"AUC {above / (found.sum() * (~found).sum()):.3f}"]
        line += [f"error of recall {100 * sets[name].sub(sets['found']).abs().mean():.1f}"]
        typer.echo(" | ".join(line))


def print_tables(
    title: str, validated: pd.DataFrame, tested: pd.DataFrame, special: pd.DataFrame
) -> None:
    """Print what `studied` returns."""
    print_validation(validated)
    print_recalls(f"{title}, generalist", tested, RULES)
    print_recalls(f"{title}, specialists", special, BY_SPECIALISTS)
    of_seeds = special.groupby(["town", "placement", "seed"])["found"].mean().unstack()
    apart = 100 * (of_seeds[1] - of_seeds[0]).abs().mean()
    typer.echo(f"seeds of a specialist are {apart:.1f} points apart on average")


def studied(folder: Path, town: int) -> tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]:
    """Study one town: validation, test of the choices, and that by specialists."""
    folder.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng(0)
    places = kerbs(obstacles_around(SumoScene(**SCENE, seed=town), Site()))
    sizes = np.arange(TRAINED + FITTED + HELD_OUT) % MOST + 1
    drawn = [(f"drawn_{i}", random.permutation(len(places))[:n]) for i, n in enumerate(sizes)]
    junction = Junction(folder, town, places, dict(drawn[:TRAINED]))
    pillars, rows = junction.detections("fitted", dict(drawn[TRAINED:-HELD_OUT]), FIT_SEED)
    network, curves = PerceptionPredictor(pillars, rows), curves_of(rows)
    rates = rows.groupby("class")["found"].mean()
    pillars, rows = junction.detections("held_out", dict(drawn[-HELD_OUT:]), HELD_OUT_SEED)
    validated = rows.assign(
        network=network.probabilities(pillars, rows),
        curve=by_curve(curves, rows, rows["points"]),
        base_rate=rows["class"].map(rates),
    )
    chosen = junction.choose(network, curves)
    sets = {f"{rule}_{n}": rig[:n] for rule, rig in chosen.items() for n in range(1, MOST + 1)}
    for d in range(DRAWS):
        order = random.permutation(len(places))
        sets |= {f"random_{n}_{d}": order[:n] for n in range(1, MOST + 1)}
    tested = junction.evaluated("chosen", sets, TEST_SEED)
    special = {key: sets[key] for rule in BY_SPECIALISTS for key in (f"{rule}_2", f"{rule}_4")}
    keys = {"evaluator": "specialist", "grid": {"placement": list(special), "seed": [0, 1]}}
    return validated, tested, junction.evaluated("special", special, TEST_SEED, **keys)


def main(folder: Annotated[Path, typer.Argument(help="folder for runs and the store")]) -> None:
    """Study all towns and print the tables, each town's and that of all."""
    torch.set_num_threads(1)
    towns = []
    for town in TOWNS:
        towns.append(studied(folder / f"town_{town}", town))
        print_tables(f"town {town}", *towns[-1])
    print_tables("all towns", *map(pd.concat, zip(*towns, strict=True)))


if __name__ == "__main__":
    typer.run(main)
