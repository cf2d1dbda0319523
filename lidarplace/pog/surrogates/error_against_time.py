"""Surrogates against what they cost: coverage method, resolution, azimuth steps, frames in the POG.

Values of different resolutions become comparable by what they measure (`comparable`): what objects
fill and what stays unseen is a volume, nats m^3; what the sheet of a cone covers is an area, nats
m^2; rays within objects are lengths, metres. What is left is the error of the grid: where sheets
are closer than voxels a voxel is covered once for several of them."""

import time
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import pandas as pd

from lidarplace.base.errors import InputError
from lidarplace.base.roi import Roi
from lidarplace.coverage import METHODS, Method
from lidarplace.coverage.cone import sensor_bits
from lidarplace.logs.box_log import BoxLog
from lidarplace.logs.boxes import frame_keys
from lidarplace.pog.occupancy.grid import OccupancyGrid
from lidarplace.pog.surrogates.evaluate import evaluate
from lidarplace.pog.surrogates.inputs import Sensing
from lidarplace.pog.surrogates.table import ASKED_OF_POG, SURROGATES, to_ask_for
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import Mount, Placement

COLUMNS = (
    *("class", "surrogate", "method", "resolution", "azimuth_steps", "frames"),
    *("value", "comparable", "reference", "seconds", "pog_seconds"),
)


class _Variant(NamedTuple):
    """One way to compute surrogates on a given POG.

    Method of coverage or of the rays, azimuth steps (0 for cones), whether the RAY_SURROGATES are
    computed or the others, and whether no other variant is more accurate."""

    method: Method
    azimuth_steps: int
    rays: bool
    best: bool = False


@dataclass(frozen=True)
class Variation:
    """Settings that are varied, one at a time.

    Attributes:
        resolutions: of the POG; they must divide the edges of the ROI.
        azimuth_steps: with which each method of rays is used.
        frame_shares: in (0, 1]; a share s is every round(1/s)-th frame."""

    resolutions: Collection[float] = ()
    azimuth_steps: Collection[int] = (90, 360, 1440, 5760)
    frame_shares: Collection[float] = (0.5, 0.25)

    def __post_init__(self) -> None:
        for share in self.frame_shares:
            if not 0 < share <= 1:
                raise InputError(key="frame_shares", expected="a number within (0, 1]", found=share)
        for steps in self.azimuth_steps:
            if steps < 1:
                raise InputError(key="azimuth_steps", expected="at least 1", found=steps)


def accuracy(
    log: BoxLog,
    roi: Roi,
    object_class: str,
    placement: Placement,
    variation: Variation = Variation(),
    sensing: Sensing = Sensing(),
    surrogates: Sequence[str] = ASKED_OF_POG.own,
) -> pd.DataFrame:
    """Compute every surrogate of a placement for a class in several ways.

    One thing is varied at a time. At the resolution of `roi` and with all frames: each method of
    rays with each number of azimuth steps, next to the cones, which know no azimuth steps (0). Only
    with cones (for the RAY_SURROGATES: `dda` with the LiDAR's own azimuth steps) each resolution
    and each share of the frames of the log, in the order of time. The reference of a surrogate is
    that at the finest resolution with all frames. Fewer azimuth steps of the RAY_SURROGATES are
    those of an `azimuth_stride`, so the sensor stays the same; its own are among them, more never.
    Method and stride of `sensing` do not matter. `surrogates` may be of plug-ins.

    Returns the COLUMNS, one row per (surrogate, method, resolution, azimuth_steps, frames):
    `comparable` is the value in units that do not depend on the resolution, `seconds` are of the
    evaluation (of `m_sog` with counting the covered voxels, of `expected_points` and `expected_ig`
    together), `pog_seconds` of counting the POG and what depends on it alone. Raises ValueError: no
    frame, a resolution that does not divide the ROI, or a bad box log."""
    if not len(log.frames):
        raise InputError(key="frames", expected="at least one", found="none")
    resolutions = dict.fromkeys((roi.resolution, *variation.resolutions))
    rois = [replace(roi, resolution=resolution) for resolution in resolutions]
    every_nth = dict.fromkeys(round(1 / share) for share in variation.frame_shares)
    settings = [(grid_roi, 1) for grid_roi in rois] + [(roi, n) for n in every_nth if n > 1]
    q = sensing.detection_probability
    options = {"detection_probability": q, "occlusion": sensing.occlusion}
    _warm_up(options)
    tables = []
    for grid_roi, every in settings:
        grid, pog_seconds = _pog(log.boxes, log.frames.iloc[::every], grid_roi, object_class)
        base = every == 1 and grid_roi == roi
        for variant in _variants(placement, variation.azimuth_steps if base else ()):
            table = _timed(grid, placement, variant, surrogates, options)
            best = grid_roi.resolution == min(resolutions) and every == 1 and variant.best
            tables.append(table.assign(reference=best, pog_seconds=pog_seconds))
    return pd.concat(tables, ignore_index=True)[list(COLUMNS)]


def scale(surrogate: str, resolution: float) -> float:
    """Return the factor that makes values of different resolutions comparable."""
    return resolution ** SURROGATES[surrogate].power


def _variants(placement: Placement, azimuth_steps: Collection[int]) -> Iterator[_Variant]:
    """Yield the most accurate ways, and further methods and steps if there are `azimuth_steps`."""
    own_steps = _azimuth_steps(placement)
    yield _Variant("cone", 0, rays=False, best=True)
    if not azimuth_steps:
        yield _Variant("dda", own_steps, rays=True, best=True)
        return
    strides = {round(own_steps / steps) for steps in azimuth_steps if steps < own_steps} | {1}
    for method in METHODS:
        if method == "cone":
            continue
        for steps in dict.fromkeys(azimuth_steps):
            yield _Variant(method, steps, rays=False)
        for stride in sorted(strides, reverse=True):
            best = method == "dda" and stride == 1
            yield _Variant(method, round(own_steps / stride), rays=True, best=best)


def _azimuth_steps(placement: Placement) -> int:
    """Return the azimuth steps of the LiDAR that has most."""
    return max(lidar.azimuth_steps for lidar in placement.lidars)


def _timed(
    grid: OccupancyGrid,
    placement: Placement,
    variant: _Variant,
    surrogates: Sequence[str],
    options: dict[str, Any],
) -> pd.DataFrame:
    """Return the rows of a variant: names, values and seconds of its surrogates."""
    sensor_bits.cache_clear()  # kept coverage would be free
    names = [name for name in surrogates if SURROGATES[name].needs_rays == variant.rays]
    names_to_ask = to_ask_for(names)
    if variant.rays:
        stride = round(_azimuth_steps(placement) / variant.azimuth_steps)
        # With "cone" the rays are those of dda, and they are not traced for coverage as well.
        method: Method = "cone" if variant.method == "dda" else variant.method
        options = options | {"surrogates": names_to_ask, "azimuth_stride": stride}
        result = evaluate(grid, placement, method, **options)
    else:
        result = evaluate(
            grid, placement, variant.method, variant.azimuth_steps or None, names_to_ask
        )
    rows = []
    for name in names:
        start = time.perf_counter()
        value = result.asked(name)  # for some the covered voxels are counted now
        rows.append((name, value, result.seconds + time.perf_counter() - start))
    table = pd.DataFrame(rows, columns=["surrogate", "value", "seconds"])
    edge = grid.roi.resolution
    table["comparable"] = [value * scale(name, edge) for name, value, _ in rows]
    table["class"], table["method"] = grid.object_class, variant.method
    table["azimuth_steps"], table["frames"] = variant.azimuth_steps, grid.frames
    return table.assign(resolution=edge)


def _pog(
    boxes: pd.DataFrame, frames: pd.DataFrame, roi: Roi, object_class: str
) -> tuple[OccupancyGrid, float]:
    """Return the POG with everything that depends on it alone, and the seconds that this took."""
    keys = frame_keys(boxes, frames)
    start = time.perf_counter()
    grid = OccupancyGrid.from_boxes(
        boxes.merge(frames[keys]), roi, object_class, frames=len(frames)
    )
    grid.prepare()
    return grid, time.perf_counter() - start


def _warm_up(options: dict[str, Any]) -> None:
    """Compile, or load, all kernels before the clock starts."""
    roi = Roi((0, 2), (0, 2), (0, 2), 1.0)
    box = {"frame": [0], "class": ["any"], "x": [1.0], "y": [1.0], "z": [1.0], "yaw": [0.1]}
    sizes = {name: [1.5] for name in ("length", "width", "height")}
    boxes = pd.DataFrame(box | sizes)
    grid, _ = _pog(boxes, pd.DataFrame({"frame": [0, 1]}), roi, "any")
    placement = Placement("any", [Mount(z=1.5)], Lidar((-0.1, 0.3), azimuth_steps=8))
    for variant in _variants(placement, (4,)):
        _timed(grid, placement, variant, ASKED_OF_POG.own, options)
