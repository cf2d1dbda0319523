"""Objects that one rig finds and another misses: counts, and frames with most of them."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.base.rings import EDGES_M, ring_of
from lidarplace.base.sectors import SECTORS, bounds_of, sector_of
from lidarplace.files.columns import one_of
from tracking.findings.groups import ONE_FOR_ALL, Group
from tracking.run_folders.sweep import RunFolder
from tracking.run_folders.sweep_tables import FOUND, OBJECTS
from tracking.statistics.all_pairs import AllPairs
from tracking.statistics.bounded_mean import with_one_at_each_bound
from tracking.statistics.jackknife import effective, error_of_units, largest
from tracking.statistics.reliability import Noise

FRAMES = 20  # frames that are shown of a pair
OCCLUSION = ("fully visible", "partly occluded", "largely occluded")  # KITTI's levels from 0 on
HEIGHTS_M = (0.0, 1.25, 1.5, 1.75, 2.0, 2.5, np.inf)
"""Bounds of the heights that distinguish objects; a bin holds its lower bound."""
DIMENSIONS = ("direction", "distance", "occlusion", "height")
"""Dimensions that distinguish objects, in addition to their class."""


@dataclass(frozen=True)
class Failures:
    """Objects that two rigs found with each seed, whose detectors under both rigs are compared.

    Attributes:
        rigs: names of the placements.
        classes: object classes that occur.
        seeds: those that judged both.
        trials: of the lowest seed, by the rigs.
        objects: columns of `objects.parquet`, one setting of the axes, in their order.
        found: of every object under each rig with each seed, shape (2, objects, seeds), bool.
        points: on every object under each rig, shape (2, objects); NaN where unknown.
        generalist: whether a seed is one detector for both rigs."""

    rigs: tuple[str, str]
    classes: tuple[str, ...]
    seeds: tuple[int, ...]
    trials: tuple[str, str]
    objects: pd.DataFrame
    found: NDArray[np.bool_]
    points: NDArray[np.int64] | NDArray[np.float64]
    generalist: bool

    @cached_property
    def shares(self) -> NDArray[np.float64]:
        """Share of the seeds that found each object under each rig, shape (2, objects)."""
        return np.asarray(self.found.mean(axis=2))

    @cached_property
    def alone(self) -> NDArray[np.float64]:
        """Share of the seeds with which each rig alone found each object, shape (2, objects)."""
        return np.asarray((self.found & ~self.found[::-1]).mean(axis=2))

    def table(self) -> pd.DataFrame:
        """Return the objects with the shares in [0, 1] that found them, and the points on them."""
        objects = self.objects.copy()
        for i, rig in enumerate(self.rigs):
            objects[f"found by {rig}"] = self.shares[i]
            objects[f"found by {rig} alone"] = self.alone[i]
            objects[f"points of {rig}"] = self.points[i]
        return objects

    def counts(self) -> pd.DataFrame:
        """Count the objects that both, one alone and none of the rigs found: means over seeds.

        A row for all objects of a class (of several classes, "all" first) and for those in each bin
        of `DIMENSIONS` that has any. Columns class; by, "" or the dimension; bin; objects;
        individuals; both, first, second and neither, which sum to objects; `difference`, first less
        second, percent of the objects, with its 95 % interval over seeds, routes and
        individuals."""
        parts = {name: (self.objects["class"] == name).to_numpy() for name in self.classes}
        if len(parts) > 1:
            parts = {"all": np.ones(len(self.objects), bool)} | parts
        rows: list[dict[str, Any]] = []
        for name, of_class in parts.items():
            bins = [("", "", of_class)]
            for by, labels, number in self._binned():
                bins += [(by, label, of_class & (number == i)) for i, label in enumerate(labels)]
            rows += [
                {"class": name, "by": by, "bin": label, **self._count(in_bin)}
                for by, label, in_bin in bins
                if in_bin.any() or not by
            ]
        return pd.DataFrame(rows)

    def _binned(self) -> Iterator[tuple[str, tuple[str, ...], NDArray[np.int64]]]:
        """Yield each dimension with the names of its bins, and the bin of every object."""
        from_the_left = sorted(range(len(SECTORS)), key=lambda sector: -bounds_of(sector)[0])
        place = np.argsort(from_the_left)[sector_of(self.objects)]
        height = np.digitize(self.objects["height"], HEIGHTS_M[1:-1])
        yield "direction", tuple(SECTORS[sector] for sector in from_the_left), place
        yield "distance", _bin_names(EDGES_M), ring_of(self.objects)
        yield "occlusion", OCCLUSION, self.objects["occluded"].to_numpy(np.int64)
        yield "height", _bin_names(HEIGHTS_M), height

    def _count(self, in_bin: NDArray[np.bool_]) -> dict[str, float]:
        objects = int(in_bin.sum())
        first, second = self.alone[:, in_bin].sum(axis=1).tolist()
        both = float((self.found[0] & self.found[1])[in_bin].mean(axis=1).sum())
        low, high = self._interval(in_bin)
        return {
            "objects": objects,
            "individuals": len(np.unique(self._units["individual"][in_bin])),
            "both": both,
            "first": first,
            "second": second,
            "neither": objects - both - first - second,
            "difference": 100 * (first - second) / objects,
            "low": low,
            "high": high,
        }

    @cached_property
    def _units(self) -> dict[str, NDArray[np.int64]]:
        """Number of the individual and of the route of each object."""
        keys = {"individual": ["scene", "object_id"], "route": ["scene", "route"]}
        return {
            unit: np.asarray(self.objects.groupby(columns, dropna=False).ngroup(), np.int64)
            for unit, columns in keys.items()
        }

    def _interval(self, in_bin: NDArray[np.bool_]) -> tuple[float, float]:
        """Estimate the difference of the shares that the rigs find, percent."""
        hits_of_rigs, errors = self.found[:, in_bin], []
        for unit, every in self._units.items():
            number = np.unique(every[in_bin], return_inverse=True)[1]
            counts = np.bincount(number).astype(np.float64)
            hits = np.zeros((len(counts), 2, len(self.seeds)))
            np.add.at(hits, number, hits_of_rigs.swapaxes(0, 1))
            rest, left = hits.sum(axis=0) - hits, (len(number) - counts)[:, None, None]
            shares = np.divide(rest, left, where=left > 0, out=np.full(rest.shape, np.nan))
            values = (100 * shares).mean(axis=2)
            errors.append(error_of_units(values, counts, pd.Index(self.rigs), unit, paired=True))
        sample = largest(errors)
        if sample is None:
            return np.nan, np.nan
        recalls = 100 * hits_of_rigs.mean(axis=1)
        (first, second), noise = recalls.mean(axis=1), Noise.of(recalls)
        individual = np.unique(self._units["individual"][in_bin], return_inverse=True)[1]
        individuals = effective(np.bincount(individual).astype(np.float64))
        centre, variance = with_one_at_each_bound(
            first - second, 2 * sample.variance, individuals, -100.0, 100.0
        )
        # units=0: one variance for all pairs, of which there is one.
        sample = replace(sample, variance=variance / 2, units=0.0)
        pairs = AllPairs.of(np.array([centre, 0.0]), noise, sample, self.generalist)
        low, high = pairs.intervals(0)[1].clip(-100, 100).tolist()
        return low, high

    def telling(self, most: int = FRAMES) -> list[int]:
        """Choose objects to show, one a frame: rows of `objects`, by turns those of each rig alone.

        A frame is worth the sum, over individuals not shown before, of the difference of the shares
        by the share of the object that can be seen."""
        lead = (self.shares[0] - self.shares[1]) * self.objects["visibility"].to_numpy(np.float64)
        individual = self._units["individual"]
        frames, frame = np.unique(self.objects["frame"], return_inverse=True)
        open_ = np.ones(len(self.objects), bool)
        chosen: list[int] = []
        for turn in range(2 * most):
            worth = np.where(open_, np.maximum(lead if turn % 2 == 0 else -lead, 0.0), 0.0)
            of_frame = np.bincount(frame, worth, len(frames))
            if len(chosen) == most or not of_frame.any():
                continue
            in_frame = frame == of_frame.argmax()
            chosen.append(int(np.where(in_frame, worth, -1.0).argmax()))
            open_ &= ~in_frame & ~np.isin(individual, individual[in_frame & (worth > 0)])
        return chosen


def _bin_names(edges: tuple[float, ...]) -> tuple[str, ...]:
    """Name bins between edges in metres, the last without end: "0–10 m", …, "over 50 m"."""
    between = [f"{low:g}–{high:g} m" for low, high in pairwise(edges[:-1])]
    return (*between, f"over {edges[-2]:g} m")


def failures(run: RunFolder, group: Group, rigs: tuple[str, str]) -> Failures | None:
    """Compare what two placements of a run found.

    None if the run folder has no objects, or no seed judged both. Raises ValueError: a value or an
    object is missing in the tables, duplicate, or of a class that the sweep does not have."""
    if run.objects is None or run.found is None or run.objects.empty:
        return None
    _check(run, run.objects, run.found)
    tested = group.of(run.trials[run.trials["placement"].isin(rigs)])
    tested = tested[tested["trial"].isin(run.found["trial"])]
    trials = tested.pivot(index="seed", columns="placement", values="trial")
    trials = trials.reindex(columns=list(rigs)).dropna().sort_index()
    if trials.empty:
        return None
    rows = run.found[run.found["trial"].isin(trials.to_numpy().ravel())]
    wide = rows.pivot(index="object", columns="trial", values="found").sort_index()
    points = rows.pivot(index="object", columns="trial", values="points").sort_index()
    objects = run.objects.set_index("object").loc[wide.index].reset_index()
    return Failures(
        rigs=rigs,
        classes=tuple(name for name in run.classes if (objects["class"] == name).any()),
        seeds=tuple(int(seed) for seed in trials.index),
        trials=tuple(trials.iloc[0]),
        objects=objects,
        found=np.stack([wide[trials[rig]].to_numpy(np.bool_) for rig in rigs]),
        points=np.stack([points[trials[rig].iloc[0]].to_numpy() for rig in rigs]),
        generalist=group.evaluator in ONE_FOR_ALL,
    )


def _check(run: RunFolder, objects: pd.DataFrame, hits: pd.DataFrame) -> None:
    """Raise ValueError that names file and column unless the tables fit each other."""
    both = ((OBJECTS, objects, ["object"]), (FOUND, hits, ["trial", "object"]))
    for contract, table, keys in both:
        file = run.path / contract.file
        for column in contract.columns:
            missing = table[column.name].isna()
            is_required = column.needed or not missing.all()  # else nothing is known of the column
            if is_required and column.dtype is not None and missing.any():
                raise InputError("missing value", place=file, key=column.name)
        twice = table.duplicated(keys)
        if twice.any():
            again = table.loc[twice, "object"].iloc[0]
            raise InputError("duplicate value", place=file, key="object", found=again)
    one_of(objects, "class", run.classes, str(run.path / OBJECTS.file))
    unknown = hits.loc[~hits["object"].isin(objects["object"]), "object"]
    if len(unknown):
        place, wanted = run.path / FOUND.file, f"an object of {OBJECTS.file}"
        raise InputError(place=place, key="object", expected=wanted, found=unknown.iloc[0])
