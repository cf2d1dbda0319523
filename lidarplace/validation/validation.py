"""Validate the simulator on a log: simulate, fit on some routes, judge on the others."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.errors import InputError, at
from lidarplace.configuration.correction import CorrectionFile
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import CLASSES, POINTS, points_of
from lidarplace.mounting.vehicle import Vehicle
from lidarplace.recall.detection_curve import default_curves
from lidarplace.rigs.correction import OTHER
from lidarplace.rigs.placement import Placement
from lidarplace.rigs.recorded import RecordedRig, one_rig
from lidarplace.validation.cloud_frames import FATES, Seen, real_clouds, seen_in
from lidarplace.validation.comparison import BELOW_M, comparison, floor
from lidarplace.validation.fit import FEWEST_TRACKS, Fit, Problem
from lidarplace.validation.shadow import returned, shadows
from lidarplace.validation.simulation import SECTORS, Recording, Returns, simulate
from lidarplace.validation.subsets import agreement, cells_by_subset, points_by_subset

MOST_CLOUDS = 60  # frames with clouds that are looked at, spread evenly; shadows need no more
LEAST_SHARE = 0.9
"""Least points of all LiDARs as a share of one LiDAR's: a data set's own counts differ a little."""
WORST = 20  # objects in the table of the worst


@dataclass(frozen=True)
class Validation:
    """Results of a validation."""

    names: tuple[str, ...]  # of the LiDARs
    correction: CorrectionFile  # fitted to all routes, or the one that was given
    given: bool  # whether the correction was given, not fitted here
    routes: int  # of what was compared, as tracks and boxes: nearer than `BELOW_M`
    tracks: int
    boxes: int
    frames: int
    clouds: int  # frames with clouds
    objects: pd.DataFrame
    """Every box, with real and simulated points: `real`, `points/shipped`, `points/corrected` and
    `real/NAME`, `shipped/NAME`, `corrected/NAME` by LiDAR; and `world`, whether the static world of
    its scene stopped rays."""
    scores: pd.DataFrame  # of `comparison`
    floor: Mapping[str, float]  # of `comparison.floor`
    fits: pd.DataFrame  # a row for each route left out
    intervals: Mapping[str, tuple[float, float]]  # from resampled tracks; empty if it was given
    subsets: pd.DataFrame  # of `lidarplace.validation.subsets`, as `agreement`
    agreement: pd.DataFrame
    shadows: NDArray[np.float64] | None  # what sectors return, shape (LiDARs, SECTORS)
    worst: pd.DataFrame  # objects whose points differ most
    without: tuple[str, ...] = ()  # object_ids that were left out, or their beginnings


def validate(
    log: BoxLog,
    folder: Path,
    correction: CorrectionFile | None = None,
    *,
    vehicle: Vehicle | None = None,
    without: Sequence[str] = (),
) -> Validation:
    """Compare the simulation of a log in a folder with what its own LiDARs returned.

    Real clouds, where `convert --clouds` kept some, are used. Without a correction one is fitted,
    and judged on routes that it was not fitted to. No vehicle: a sedan. Objects `without`, by their
    object_id or its beginning, such as wrong labels, neither hide nor count.

    Raises InputError: an object to leave out is not there, there are no counts, all LiDARs have
    fewer points than one of them, there is no rig, rigs of different scenes differ in their LiDARs,
    or no object has real points."""
    rig, log = _checked(_left_out(log, without, folder), folder)
    names, objects = rig.names, _objects(log)
    _check_counts(log.boxes, folder)
    frames = log.frames["frame"].tolist()
    recording = Recording(log, rig.placement, 0, vehicle)
    returns = own = simulate(recording, frames)
    model = _geometry(rig, correction)
    if model != rig.placement:
        recording = replace(recording, placement=model)
        own = simulate(recording, frames)
    route_of = log.frames.set_index("frame")["route"]
    clouds = list(real_clouds(folder, len(names), MOST_CLOUDS))
    share = {c.frame: returned(c.points, c.lidar, rig.placement, vehicle) for c in clouds}

    def shadow(left_out: object = None) -> NDArray[np.float64]:
        kept = [s for frame, s in share.items() if route_of[frame] != left_out]
        return shadows(kept) if kept else np.ones((len(names), SECTORS))

    classes = log.boxes["class"].to_numpy(str)
    lossless = Fit({OTHER: 1.0}, None)
    models: dict[object, tuple[Fit, NDArray[np.float64]]] = {}
    rows = []
    near = (objects["distance"] < BELOW_M) & objects["real"].notna()
    for route in sorted(objects["route"].dropna().unique()):
        if correction is not None:
            models[route] = _given(correction), _masks(correction, names)
            continue
        mask, there = shadow(route), objects["route"] == route
        try:
            fitted = Problem.of(objects[~there], own, mask[own.lidar, own.sector]).fit()
        except ValueError:  # the only route, or no points on the others
            fitted = lossless
        models[route], distance = (fitted, mask), fitted.distance or math.inf
        boxes = int((near & there).sum())
        rows.append({"route": route, "boxes": boxes, **fitted.factor, "distance": distance})
    plain = np.ones(len(returns.box))
    _simulated(objects, "shipped", returns, lossless.points(returns, classes, plain), names)
    expected, route_of_box = np.zeros(len(own.box)), objects["route"].to_numpy()[own.box]
    for left_out, (fitted, mask) in models.items():
        which = route_of_box == left_out
        expected[which] = fitted.points(own, classes, mask[own.lidar, own.sector])[which]
    _simulated(objects, "corrected", own, expected, names)
    if correction is None:
        mask = shadow()
        problem = Problem.of(objects, own, mask[own.lidar, own.sector])
        with at(folder / "boxes.parquet"):
            final, intervals = problem.fit(), problem.intervals()
    else:
        problem = Problem.of(objects, own, np.ones(len(own.box)))
        final, intervals, mask = _given(correction), {}, _masks(correction, names)

    seen: list[Seen] = []
    curves = default_curves()
    for cloud in clouds:
        fitted, own_mask = models[route_of[cloud.frame]]
        factor, loss = fitted.factors(classes), 1.0 / (fitted.distance or math.inf)
        seen.append(seen_in(cloud, recording, own_mask, factor, loss, curves.cell))
    counted, by_points = objects[near], points_by_subset(objects, names)
    by_cells = cells_by_subset(seen, classes, near.to_numpy(), names, curves)
    subsets = pd.concat([by_points, by_cells], ignore_index=True)
    routes, dark = int(counted["route"].nunique()), mask if clouds or correction else None
    facts = {"routes": routes, "tracks": problem.tracks, "boxes": len(counted)}
    return Validation(
        names=names,
        correction=correction or _file(final, names, dark, facts),
        given=correction is not None,
        routes=routes,
        tracks=problem.tracks,
        boxes=len(counted),
        frames=len(frames),
        clouds=len(clouds),
        objects=objects,
        scores=comparison(objects, ("shipped", "corrected")),
        floor=floor(objects),
        fits=pd.DataFrame(rows),
        intervals=intervals,
        subsets=subsets,
        agreement=agreement(subsets),
        shadows=dark,
        worst=_worst(counted, seen),
        without=tuple(without),
    )


def _check_counts(boxes: pd.DataFrame, folder: Path) -> None:
    for name, column in points_of(boxes).items() if POINTS in boxes else ():
        total = boxes[[POINTS, column]].dropna().sum()
        if total[POINTS] < LEAST_SHARE * total[column]:
            problem, expected = f"fewer points than of LiDAR {name} alone", f"{total[column]:,.0f}"
            place, found = folder / "boxes.parquet", f"{total[POINTS]:,.0f}"
            raise InputError(problem, place=place, key=POINTS, expected=expected, found=found)


def _left_out(log: BoxLog, without: Sequence[str], folder: Path) -> BoxLog:
    """Leave out the boxes of some objects; raise InputError if there is no such object."""
    ids = log.boxes["object_id"].astype(str)
    gone: set[str] = set()
    for name in without:
        found = sorted({own for own in ids if name and own.startswith(name)})
        if name not in found and len(found) != 1:
            raise InputError(
                f"no single object {name!r}", place=folder / "boxes.parquet", key="object_id",
                expected="the object_id of one object, or its beginning",
                found=", ".join(found[:2]) + (", …" if len(found) > 2 else "") or "none",
            )  # fmt: skip
        gone.add(name if name in found else found[0])
    return replace(log, boxes=log.boxes[~ids.isin(gone)])


def _checked(log: BoxLog, folder: Path) -> tuple[RecordedRig, BoxLog]:
    """Return the rig of all scenes that were counted, and the log of these scenes, boxes from 0."""
    table, rigs = folder / "boxes.parquet", folder / "rig.json"
    if not len(log.boxes):
        raise InputError(place=table, expected="boxes with real points", found="no boxes")
    if POINTS not in log.boxes or log.boxes[POINTS].notna().sum() == 0:
        fix = "convert the data set again; with --clouds where it has no counts"
        raise InputError(place=table, key=POINTS, expected="real points", found="none", fix=fix)
    counted = log.boxes.loc[log.boxes[POINTS].notna(), "scene"].unique()
    missing = [scene for scene in counted if scene not in log.rigs]
    if missing:
        raise InputError(
            "real points without the rig that recorded them", place=rigs, key=f"scene {missing[0]}",
            expected=f"the rigs of {len(counted)} scenes", found=len(counted) - len(missing),
            fix="convert the data set again with its calibration, or with --rig",
        )  # fmt: skip
    with at(rigs):
        rig = one_rig({scene: log.rigs[scene] for scene in counted})
    if unknown := sorted(set(points_of(log.boxes)) - set(rig.names)):
        known = f"real points of {', '.join(rig.names)}, the LiDARs of the rig"
        raise InputError(place=table, key=POINTS, expected=known, found=unknown[0])
    frames = log.frames[log.frames["scene"].isin(counted)]
    boxes = log.boxes[log.boxes["frame"].isin(frames["frame"])].reset_index(drop=True)
    if not (boxes[POINTS] > 0).any():
        raise InputError(place=table, key=POINTS, expected="real points", found="0 of every box")
    return rig, replace(log, boxes=boxes, frames=frames)


def _objects(log: BoxLog) -> pd.DataFrame:
    """Tabulate boxes with their distance, route and real points.

    In a log that has classes of `CLASSES` others only hide what is behind them."""
    boxes = log.boxes
    own = boxes[["scene", "frame", "object_id", "class", "x", "y", "z"]].copy()
    own["route"] = boxes["frame"].map(log.frames.set_index("frame")["route"])
    own["world"] = boxes["scene"].isin(list(log.world))
    own["distance"] = np.hypot(boxes["x"], boxes["y"])
    own["real"] = boxes[POINTS].astype(np.float64)
    for name, column in points_of(boxes).items():
        own[f"real/{name}"] = boxes[column].astype(np.float64)
    named = own["class"].isin(CLASSES)
    if named.any():
        own.loc[~named, [str(name) for name in own if str(name).startswith("real")]] = np.nan
    return own


def _simulated(
    objects: pd.DataFrame,
    model: str,
    returns: Returns,
    expected: NDArray[np.float64],
    names: Sequence[str],
) -> None:
    """Add the columns of a model to `objects`."""
    size = len(objects)
    objects[f"rays/{model}"] = np.bincount(returns.box, returns.points, size)
    objects[f"points/{model}"] = np.bincount(returns.box, expected, size)
    for number, name in enumerate(names):
        own = returns.lidar == number
        objects[f"{model}/{name}"] = np.bincount(returns.box[own], expected[own], size)
        if f"real/{name}" not in objects:
            objects[f"real/{name}"] = np.nan if len(names) > 1 else objects["real"]


def _worst(objects: pd.DataFrame, seen: Sequence[Seen]) -> pd.DataFrame:
    """List objects whose points differ most after the correction, each in its worst frame.

    With what became of their rays; where there are clouds those of their frames, whose reason is
    known."""
    table = objects[["scene", "frame", "object_id", "class", "distance", "real"]].copy()
    table["shipped"], table["corrected"] = objects["points/shipped"], objects["points/corrected"]
    for number, fate in enumerate(FATES):
        known = [pd.Series(own.fates[:, number], own.rows, dtype=np.float64) for own in seen]
        table[fate] = pd.concat(known) if known else np.nan
    if seen:
        table = table[table[list(FATES)].notna().all(axis=1)]
    # A few points do not matter.
    off = pd.Series(np.log2((table["corrected"] + 2.0) / (table["real"] + 2.0)), table.index)
    table["log2"] = off
    reasons = table[list(FATES[1:])].fillna(0.0)
    reason = reasons.idxmax(axis=1).where(reasons.sum(axis=1) > 0, "")
    fewer = np.where(table["shipped"] > 0, "too few simulated", "hidden in the simulation alone")
    table["reason"] = np.where(off > 0, reason, fewer) if seen else ""
    worst = table.loc[off.abs().sort_values(ascending=False).index]
    return worst.drop_duplicates(["scene", "object_id"])[:WORST]


def _given(file: CorrectionFile) -> Fit:
    return Fit({OTHER: 1.0} | dict(file.factor), file.distance)


def _masks(file: CorrectionFile, names: Sequence[str]) -> NDArray[np.float64]:
    """Return masks of a file at the middles of sectors, (LiDARs, SECTORS); 1 without one."""
    middle = (np.arange(SECTORS) + 0.5) / SECTORS * 2 * math.pi - math.pi
    masks = [file.lidars[n].mask if n in file.lidars else None for n in names]
    level = np.zeros(SECTORS)
    return np.array([np.ones(SECTORS) if m is None else m.mask.at(middle, level) for m in masks])


def _geometry(rig: RecordedRig, file: CorrectionFile | None) -> Placement:
    """Apply the rays of a correction to the rig, without what it thins."""
    if file is None:
        return rig.placement
    lidars = [
        replace(file.applied_to(lidar, name if name in file.lidars else None), correction=None)
        for name, lidar in zip(rig.names, rig.placement.lidars, strict=True)
    ]
    return rig.placement.with_lidar(lidars)


def _file(
    fit: Fit, names: Sequence[str], dark: NDArray[np.float64] | None, facts: dict[str, int]
) -> CorrectionFile:
    lidars: dict[str, object] = {name: {} for name in names}
    for name, row in zip(names, () if dark is None else dark, strict=False):
        if (row < 1.0).any():
            shares = [round(float(share), 3) for share in row]
            lidars[name] = {"mask": {"azimuth_deg": 360.0 / SECTORS, "shares": shares}}
    few = {"too_few_tracks": True} if facts["tracks"] < FEWEST_TRACKS else {}
    fitted = facts | {"below_m": BELOW_M} | few
    factor = {str(name): round(share, 4) for name, share in fit.factor.items()}
    further = [name for name in factor if name not in (*CLASSES, OTHER)]
    known = {"factor": factor, "classes": further, "lidars": lidars, "fitted": fitted}
    return CorrectionFile.model_validate(known | {"distance": fit.distance})
