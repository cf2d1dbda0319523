"""Cases from a seed: which file of a target is made wrong, and how."""

import contextlib
import shutil
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import TypeVar

from tests.fuzz import mutate_bytes, mutate_files, mutate_tables
from tests.fuzz.judge import DONE, Outcome, inside, judge_reader, judge_verb
from tests.fuzz.mutate_bytes import Mutation
from tests.fuzz.mutate_values import json_syntax, json_value, yaml_syntax, yaml_value
from tests.fuzz.targets import Target, app_of, parts_of

T = TypeVar("T")
Run = Callable[[T, int, int, Path, Path], "Result"]
"""Runs a case: of a target, by its seed and its number, of this world, in this new folder."""

BY_SUFFIX: dict[str, Sequence[Mutation]] = {
    ".parquet": mutate_tables.ANY,
    ".csv": mutate_tables.ANY,
    ".feather": mutate_tables.ANY,
    ".gz": mutate_tables.ANY,
    ".txt": mutate_files.TEXT,
    ".json": (json_value, json_value, json_syntax),
    ".yaml": (yaml_value, yaml_value, yaml_syntax),
    ".npz": (mutate_files.npz,),
    ".npy": (mutate_files.npy,),
    ".pt": mutate_files.CHECKPOINT,
}
"""What fits a file, beside `mutate_bytes.ANY`."""


@dataclass(frozen=True)
class Result:
    """A case and what came of it.

    Attributes:
        target: its name.
        case: seed and number.
        what: which file was made wrong, and how.
    """

    target: str
    case: str
    what: str
    outcome: Outcome

    def __str__(self) -> str:
        return f"{self.target} {self.case}: {self.what}: {self.outcome.kind}\n{self.outcome.told}"


def run_case(target: Target, seed: int, number: int, world: Path, place: Path) -> Result:
    """Make one file of a copy of `world` wrong, in the new folder `place`, and read it."""
    random = Random(f"{target.name}/{seed}/{number}")
    files = sorted(path for pattern in target.files.split() for path in world.glob(pattern))
    chosen = random.choice(files).relative_to(world)
    parts = parts_of(f"{chosen} {target.line} {target.needs}", world)
    copied(world, place, parts)
    path = place / chosen
    fitting = BY_SUFFIX.get(path.suffix, ())
    # Most cases are of the kind of the file: its bytes are made wrong in few ways.
    mutations = fitting if fitting and random.random() < 0.75 else mutate_bytes.ANY
    change = random.choice(mutations)(path, random)
    outcome = outcome_of(target, path, place)
    shutil.rmtree(place)
    return Result(target.name, f"{seed} {number}", f"{chosen}: {change}", outcome)


def copied(world: Path, place: Path, parts: Collection[str]) -> None:
    """Make the folder `place` with copies of parts of the world."""
    place.mkdir(parents=True)
    for part in sorted(parts):
        whole = world / part
        (shutil.copytree if whole.is_dir() else shutil.copy)(whole, place / part)


def outcome_of(target: Target, path: Path, place: Path) -> Outcome:
    """Outcome of the target in the folder `place`, of which it reads `path` among others."""
    with contextlib.chdir(place):
        return _outcome(target, path, place)


def _outcome(target: Target, path: Path, place: Path) -> Outcome:
    folders = [folder.name for folder in path.relative_to(place).parents]
    places = (*inside(path, place), *(f"/{name}" for name in folders if name), "--", "CARLA server")
    places += tuple(place for name in folders if name for place in (f"{name}:", f" of {name} "))
    if target.read is not None:
        read = target.read
        outcome = judge_reader(lambda: read(place), places)
    else:
        arguments = target.line.format(path.name).split()[1:]
        outcome = judge_verb(app_of(target.line), arguments, places, target.codes)
    if outcome.kind == DONE and (nonsense := target.check(place)):
        return Outcome("nonsense was accepted", nonsense)
    return outcome


def faults(
    run: Run[T], targets: Sequence[T], seed: int, count: int, world: Path, folder: Path
) -> list[str]:
    """List `count` cases of each target that were neither done nor refused."""
    results = [
        run(target, seed, number, world, folder / f"{place}-{number}")
        for place, target in enumerate(targets)
        for number in range(count)
    ]
    return [str(result) for result in results if result.outcome.fault]
