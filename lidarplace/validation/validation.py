"""Validate the simulator on a log: simulate, fit on some routes, evaluate on the others."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

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
from lidarplace.validation.cloud_frames import (
    FATES,
    CellHits,
    Cloud,
    Overlay,
    compare_cloud,
    overlay_of,
    real_clouds,
)
from lidarplace.validation.comparison import BELOW_M, comparison, floor
from lidarplace.validation.fit import FEWEST_TRACKS, LOSSLESS, Fit, FitData, Thinning
from lidarplace.validation.shadow import returned, shadows
from lidarplace.validation.simulation import SECTORS, Returns, SimulatedRig, simulate
from lidarplace.validation.subsets import agreement, cells_by_subset, points_by_subset

MOST_CLOUDS = 60  # frames with clouds that are looked at, spread evenly; shadows need no more
LEAST_SHARE = 0.9
"""Least points of all LiDARs as a share of one LiDAR's: a data set's own counts differ a little."""
WORST = 20  # objects in the table of the worst
OVERLAYS = 6  # of them whose points are shown


@dataclass(frozen=True)
class Validation:
    """Results of a validation."""

    names: tuple[str, ...]  # of the LiDARs
    correction: CorrectionFile  # fitted to all routes, or the one that was given
    correction_given: bool  # whether the correction was given, not fitted here
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
    intervals: Mapping[str, tuple[float, float]]  # of `FitData.intervals`; empty if given
    subsets: pd.DataFrame  # of `lidarplace.validation.subsets`, as `agreement`
    agreement: pd.DataFrame
    shadows: NDArray[np.float64] | None  # what sectors return, shape (LiDARs, SECTORS)
    worst: pd.DataFrame  # objects whose points differ most
    overlays: tuple[Overlay, ...]  # points of the first of them, where there are clouds
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
    and evaluated on routes that it was not fitted to. No vehicle: a sedan. Objects `without`, by
    their object_id or its beginning, such as wrong labels, neither hide nor count.

    Raises InputError: an object to leave out is missing, there are no counts or no rig, all LiDARs
    have fewer points than one, rigs of scenes differ, or no object has real points."""
    rig, log = rig_and_counted_log(_left_out(log, without, folder), folder)
    names, objects = rig.names, object_table(log)
    classes, frames = log.boxes["class"].to_numpy(str), log.frames["frame"].tolist()
    as_shipped = SimulatedRig(log, rig.placement, 0, vehicle)
    geometry = _geometry(rig, correction)
    is_shipped = geometry == rig.placement
    recording = as_shipped if is_shipped else replace(as_shipped, placement=geometry)
    shipped = simulate(as_shipped, frames)
    returns = shipped if is_shipped else simulate(recording, frames)
    route_of = log.frames.set_index("frame")["route"]
    clouds = list(real_clouds(folder, len(names), MOST_CLOUDS))
    shares = {c.frame: returned(c.points, c.lidar, rig.placement, vehicle) for c in clouds}
    counted = objects[near := (objects["distance"] < BELOW_M) & objects["real"].notna()]
    tracks = counted.groupby(["scene", "object_id"]).ngroups
    facts = {"routes": int(counted["route"].nunique()), "tracks": tracks, "boxes": len(counted)}
    with at(folder / "boxes.parquet"):
        fits = (
            _fit(objects, counted, returns, shares, route_of, len(names))
            if correction is None
            else _given(correction, objects, names)
        )
    shadow = fits.final.mask if clouds or correction else None
    _add_model(objects, "shipped", shipped, LOSSLESS.points(shipped, classes), names)
    corrected = _corrected_points(objects["route"], returns, fits.by_route, classes)
    _add_model(objects, "corrected", returns, corrected, names)
    hits = [compare_cloud(c, recording, fits.by_route[route_of[c.frame]], classes) for c in clouds]
    by_cells = cells_by_subset(hits, classes, near.to_numpy(), names, default_curves())
    worst = _worst(objects[near], hits)
    subsets = pd.concat([points_by_subset(objects, names), by_cells], ignore_index=True)
    return Validation(
        names=names,
        correction=correction or _file(fits.final.fit, names, shadow, facts),
        correction_given=correction is not None,
        **facts,
        frames=len(frames),
        clouds=len(clouds),
        objects=objects,
        scores=comparison(objects, ("shipped", "corrected")),
        floor=floor(objects),
        fits=fits.table,
        intervals=fits.intervals,
        subsets=subsets,
        agreement=agreement(subsets),
        shadows=shadow,
        worst=worst,
        overlays=_overlays(worst[:OVERLAYS], clouds, as_shipped),
        without=tuple(without),
    )


class _Fits(NamedTuple):
    """Corrections to evaluate a log with: for each route that of the others, and that of all."""

    by_route: Mapping[object, Thinning]
    final: Thinning
    table: pd.DataFrame  # a row for each route left out
    intervals: Mapping[str, tuple[float, float]]


def _fit(
    objects: pd.DataFrame,
    counted: pd.DataFrame,
    returns: Returns,
    shares: Mapping[int, NDArray[np.float64]],
    route_of: pd.Series,
    lidars: int,
) -> _Fits:
    """Fit corrections; `shares` are `returned` of frames with a cloud."""

    def mask_without(route: object) -> NDArray[np.float64]:
        others = [share for frame, share in shares.items() if route_of[frame] != route]
        return shadows(others) if others else np.ones((lidars, SECTORS))

    by_route, rows = {}, []
    for route in sorted(objects["route"].dropna().unique()):
        mask, others = mask_without(route), objects[objects["route"] != route]
        try:
            fit = FitData.of(others, returns, returns.shares(mask)).fit()
        except ValueError:  # the only route, or no points on the others
            fit = LOSSLESS
        by_route[route] = Thinning(fit, mask)
        row = {"route": route, "boxes": int((counted["route"] == route).sum())}
        rows.append({**row, **fit.factor, "distance": fit.distance or math.inf})
    mask = mask_without(None)
    data = FitData.of(objects, returns, returns.shares(mask))
    return _Fits(by_route, Thinning(data.fit(), mask), pd.DataFrame(rows), data.intervals())


def _given(file: CorrectionFile, objects: pd.DataFrame, names: Sequence[str]) -> _Fits:
    fit = Fit({OTHER: 1.0} | dict(file.factor), file.distance)
    thinning = Thinning(fit, _masks(file, names))
    by_route = dict.fromkeys(objects["route"].dropna().unique(), thinning)
    return _Fits(by_route, thinning, pd.DataFrame(), {})


def _corrected_points(
    routes: pd.Series,
    returns: Returns,
    by_route: Mapping[object, Thinning],
    classes: NDArray[np.str_],
) -> NDArray[np.float64]:
    """Compute expected returns, each by the correction that its own route did not fit."""
    points, route_of_box = np.zeros(len(returns.box)), routes.to_numpy()[returns.box]
    for route, thinning in by_route.items():
        of_route = route_of_box == route
        points[of_route] = thinning.points(returns, classes)[of_route]
    return points


def _check_counts(boxes: pd.DataFrame, folder: Path) -> None:
    for name, column in points_of(boxes).items() if POINTS in boxes else ():
        total = boxes[[POINTS, column]].dropna().sum()
        if total[POINTS] < LEAST_SHARE * total[column]:
            problem, expected = f"fewer points than of LiDAR {name} alone", f"{total[column]:,.0f}"
            parts = {"place": str(folder / "boxes.parquet"), "found": f"{total[POINTS]:,.0f}"}
            raise InputError(problem, key=POINTS, expected=expected, **parts)


def _left_out(log: BoxLog, without: Sequence[str], folder: Path) -> BoxLog:
    """Leave out the boxes of some objects; raise InputError if there is no such object."""
    ids = log.boxes["object_id"].astype(str)
    gone: set[str] = set()
    for name in without:
        matches = sorted({object_id for object_id in ids if name and object_id.startswith(name)})
        if name not in matches and len(matches) != 1:
            raise InputError(
                f"no single object {name!r}", place=folder / "boxes.parquet", key="object_id",
                expected="the object_id of one object, or its beginning",
                found=", ".join(matches[:2]) + (", …" if len(matches) > 2 else "") or "none",
            )  # fmt: skip
        gone.add(name if name in matches else matches[0])
    return replace(log, boxes=log.boxes[~ids.isin(gone)])


def rig_and_counted_log(log: BoxLog, folder: Path) -> tuple[RecordedRig, BoxLog]:
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
        expected = f"real points of {', '.join(rig.names)}, the LiDARs of the rig"
        raise InputError(place=table, key=POINTS, expected=expected, found=unknown[0])
    frames = log.frames[log.frames["scene"].isin(counted)]
    boxes = log.boxes[log.boxes["frame"].isin(frames["frame"])].reset_index(drop=True)
    if not (boxes[POINTS] > 0).any():
        raise InputError(place=table, key=POINTS, expected="real points", found="0 of every box")
    _check_counts(boxes, folder)
    return rig, replace(log, boxes=boxes, frames=frames)


def object_table(log: BoxLog) -> pd.DataFrame:
    """Tabulate boxes with their distance, route and real points.

    In a log that has classes of `CLASSES` others only hide what is behind them."""
    boxes = log.boxes
    objects = boxes[["scene", "frame", "object_id", "class", "x", "y", "z"]].copy()
    objects["route"] = boxes["frame"].map(log.frames.set_index("frame")["route"])
    objects["world"] = boxes["scene"].isin(list(log.world))
    objects["distance"] = np.hypot(boxes["x"], boxes["y"])
    objects["real"] = boxes[POINTS].astype(np.float64)
    for name, column in points_of(boxes).items():
        objects[f"real/{name}"] = boxes[column].astype(np.float64)
    named = objects["class"].isin(CLASSES)
    if named.any():
        real = [str(name) for name in objects if str(name).startswith("real")]
        objects.loc[~named, real] = np.nan
    return objects


def _add_model(
    objects: pd.DataFrame,
    model: str,
    returns: Returns,
    points: NDArray[np.float64],
    names: Sequence[str],
) -> None:
    size = len(objects)
    objects[f"rays/{model}"] = np.bincount(returns.box, returns.points, size)
    objects[f"points/{model}"] = np.bincount(returns.box, points, size)
    for number, name in enumerate(names):
        of_lidar = returns.lidar == number
        objects[f"{model}/{name}"] = np.bincount(returns.box[of_lidar], points[of_lidar], size)
        if f"real/{name}" not in objects:
            objects[f"real/{name}"] = np.nan if len(names) > 1 else objects["real"]


def _worst(objects: pd.DataFrame, hits: Sequence[CellHits]) -> pd.DataFrame:
    """List objects whose points differ most after the correction, with what became of their rays.

    Each is in its worst frame; where there are clouds those of their frames, whose reason is known.
    """
    table = objects[["scene", "frame", "object_id", "class", "distance", "real"]].copy()
    table["shipped"], table["corrected"] = objects["points/shipped"], objects["points/corrected"]
    for number, fate in enumerate(FATES):
        counts = [pd.Series(hit.fates[:, number], hit.rows, dtype=np.float64) for hit in hits]
        table[fate] = pd.concat(counts) if counts else np.nan
    if hits:
        table = table[table[list(FATES)].notna().all(axis=1)]
    # A few points do not matter.
    off = pd.Series(np.log2((table["corrected"] + 2.0) / (table["real"] + 2.0)), table.index)
    table["log2"] = off
    reasons = table[list(FATES[1:])].fillna(0.0)
    reason = reasons.idxmax(axis=1).where(reasons.sum(axis=1) > 0, "")
    fewer = np.where(table["shipped"] > 0, "too few simulated", "hidden in the simulation alone")
    table["reason"] = np.where(off > 0, reason, fewer) if hits else ""
    worst = table.loc[off.abs().sort_values(ascending=False).index]
    return worst.drop_duplicates(["scene", "object_id"])[:WORST]


def _overlays(
    worst: pd.DataFrame, clouds: Sequence[Cloud], simulated: SimulatedRig
) -> tuple[Overlay, ...]:
    cloud_of = {cloud.frame: cloud for cloud in clouds}
    rows = zip(worst.index.tolist(), worst["frame"].tolist(), strict=True) if clouds else ()
    return tuple(overlay_of(row, cloud_of[frame], simulated) for row, frame in rows)


def _masks(file: CorrectionFile, names: Sequence[str]) -> NDArray[np.float64]:
    """Return masks of a file at the middles of sectors, (LiDARs, SECTORS); 1 without one."""
    azimuth = (np.arange(SECTORS) + 0.5) / SECTORS * 2 * math.pi - math.pi
    masks = [file.lidars[n].mask if n in file.lidars else None for n in names]
    level = np.zeros(SECTORS)
    return np.array([np.ones(SECTORS) if m is None else m.mask().at(azimuth, level) for m in masks])


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
    fit: Fit, names: Sequence[str], mask: NDArray[np.float64] | None, facts: dict[str, int]
) -> CorrectionFile:
    lidars: dict[str, object] = {name: {} for name in names}
    for name, row in zip(names, () if mask is None else mask, strict=False):
        if (row < 1.0).any():
            shares = [round(float(share), 3) for share in row]
            lidars[name] = {"mask": {"azimuth_deg": 360.0 / SECTORS, "shares": shares}}
    few = {"too_few_tracks": True} if facts["tracks"] < FEWEST_TRACKS else {}
    fitted = facts | {"below_m": BELOW_M} | few
    factor = {str(name): round(share, 4) for name, share in fit.factor.items()}
    further = [name for name in factor if name not in (*CLASSES, OTHER)]
    keys = {"factor": factor, "classes": further, "lidars": lidars, "fitted": fitted}
    distance = None if fit.distance is None else round(fit.distance, 1)
    return CorrectionFile.model_validate(keys | {"distance": distance})
