"""Takes from run folders what the page needs: the tables in `tables/`.

Run as `python studies/findings/distil.py [RUNS]`, RUNS the folder of the run folders, `runs` by
default. A run that is not there leaves its tables as they are.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
from candidates import FOLDER
from rich import print as show

from tracking.run_folders.sweep import RunFolder

TABLES = FOLDER / "tables"
TARGETS = (
    ("Car", "AP_R40_3D", 0.7),
    ("Car", "AP_R40_3D", 0.5),
    ("Car", "AP_R40_3D_mean", 0.0),
    ("Car", "class_recall_3D", 0.5),
    ("Pedestrian", "AP_R40_3D", 0.5),
    ("Pedestrian", "class_recall_3D", 0.5),
    ("Cyclist", "AP_R40_3D", 0.5),
    ("Cyclist", "class_recall_3D", 0.5),
    ("all", "recall", 0.5),
)
"""Class, metric, IoU; 0: over all of them."""
ONLY_IN = {"riddle": (("Car", "AP_R40_BEV", 0.7),)}
"""Targets that one table has besides: the paper prints them, too."""
SOURCES = {
    "main": ("generalist", "seed1", "seed2", "seed3", "aside"),
    "later": ("later",),
    "exact": ("exact",),
    "riddle": ("riddle",),
    "controlled": ("controlled",),
    "second": ("second",),
    "finetuned": ("finetuned",),
    "longer": ("longer",),
    "carla": ("carla",),
    "sparse": ("sparse",),
    "products": ("products",),
    "released": ("released",),
    "anchors": ("anchors",),
    "second_own": ("second_own",),
    "random": ("random",),
    "shipped": ("shipped",),
    "quarter": ("quarter",),
}
"""Of each table the run folders, `findings_` before their names."""
MEANS_ALONE = (
    *("exact", "second", "finetuned", "longer", "carla", "sparse", "second_own"),
    *("random", "shipped", "quarter"),
)
"""Tables whose values without a route or an individual nothing asks for."""
BY_DISTANCE = ("controlled",)
"""Tables of which Car AP over IoU is asked for by distance, too."""
OTHER_SCENES = ("carla", "sparse")
"""Other towns or traffic."""
OWN_SURROGATES = (*OTHER_SCENES, "products", "random")
"""Of other scenes or rigs than the main table."""
DRAWN = ("drawn", "random_drawn")
"""Expected recall over drawn mounts, of the rigs of the main table and of the random ones."""
BESIDES = ("candidates", "findings_occluded")
"""Run folders without detectors, which took their time, too."""
_ONLY_OF_RUNS = ("trial", "detector", "difficulty")


def main() -> None:
    """Write what there is and say of what."""
    runs = Path(sys.argv[1] if len(sys.argv) > 1 else "runs")
    for name, parts in SOURCES.items():
        folders = [runs / f"findings_{part}" for part in parts]
        found = [RunFolder.read(f) for f in folders if (f / "results.parquet").exists()]
        if not found:
            continue
        show(f"{name}: {', '.join(run.sweep.name for run in found)}")
        wanted = [*TARGETS, *ONLY_IN.get(name, ())]
        _write(f"{name}_results", [_wanted(_judged(run, run.results), wanted) for run in found])
        if name in BY_DISTANCE:
            rings = [_wanted(_judged(run, run.distance), TARGETS[2:3]) for run in found]
            _write(f"{name}_distance", rings)
        if name in OWN_SURROGATES:
            _write(f"{name}_surrogates", [run.surrogates[_SURROGATES] for run in found])
        if name == "random":
            _write("random_individuals", [_of_tests(run.individuals) for run in found])
        if name in MEANS_ALONE:
            continue
        left_out = [_of_units(_wanted(_judged(run, run.left_out), wanted)) for run in found]
        _write(f"{name}_left_out", left_out)
        if name == "main":
            _write("surrogates", [run.surrogates[_SURROGATES] for run in found[:1]])
            _write("individuals", [] if found[0].individuals is None else [found[0].individuals])
    occluded = runs / "findings_occluded"
    if (occluded / "surrogates.parquet").exists():
        own = RunFolder.read(occluded).surrogates[_SURROGATES]
        _write("occluded", [own.assign(surrogate="expected_ig, occluded")])
    for name in DRAWN:
        folder = runs / f"findings_{name}"
        if (folder / "surrogates.parquet").exists():
            _write(name, [RunFolder.read(folder).surrogates[_SURROGATES]])
    _write("hours", _hours(runs))


def _of_tests(individuals: pd.DataFrame | None) -> pd.DataFrame:
    """How many test objects there are of each class."""
    if individuals is None:
        raise ValueError("the run has no individuals.parquet")
    rows = individuals.query("split == 'test'").drop_duplicates()
    return rows.groupby("class", as_index=False).size()


def _hours(runs: Path) -> list[pd.DataFrame]:
    """Of each stage tasks and hours, if all runs are there; what several read counts once."""
    names = [f"findings_{part}" for parts in SOURCES.values() for part in parts]
    files = [runs / name / "tasks.parquet" for name in (*names, *BESIDES)]
    if not all(file.exists() for file in files):
        return []
    tasks = pd.concat(map(pd.read_parquet, files)).drop_duplicates("key")
    seconds = tasks.groupby("stage")["seconds"]
    return [pd.DataFrame({"tasks": seconds.size(), "hours": seconds.sum() / 3600}).reset_index()]


_SURROGATES = ["placement", "class", "surrogate", "value"]


def _judged(run: RunFolder, table: pd.DataFrame | None) -> pd.DataFrame:
    """With the evaluator as a column, which it is not where all rows have the same."""
    if table is None:
        raise ValueError(f"{run.path} has no left_out.parquet")
    return table if "evaluator" in table else table.assign(evaluator=run.sweep.evaluator)


def _wanted(table: pd.DataFrame, targets: Sequence[tuple[str, str, float]]) -> pd.DataFrame:
    keys = pd.MultiIndex.from_frame(table[["class", "metric", "iou"]].round({"iou": 6}))
    own = table[keys.isin(targets)]
    return own.drop(columns=[name for name in _ONLY_OF_RUNS if name in own])


def _of_units(left_out: pd.DataFrame) -> pd.DataFrame:
    """Of routes and individuals alone, as small as it can be."""
    return left_out[left_out["unit"] != "half"].astype({"value": "float32"})


def _write(name: str, parts: list[pd.DataFrame]) -> None:
    if parts:
        table = pd.concat(parts, ignore_index=True)
        TABLES.mkdir(exist_ok=True)
        temporary = TABLES / f".{name}.parquet"
        table.to_parquet(temporary, index=False, compression="zstd")
        temporary.replace(TABLES / f"{name}.parquet")


if __name__ == "__main__":
    main()
