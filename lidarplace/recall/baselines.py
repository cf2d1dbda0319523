"""Measures of what is seen of objects that take no training: what `expected_recall` has to beat."""

from __future__ import annotations

import numpy as np
import pandas as pd

from lidarplace.base.kernel_cache import njit
from lidarplace.logs.boxes import SIZE
from lidarplace.recall.counted_objects import CountedObjects
from lidarplace.recall.surface_cells import SurfaceCells, slices_of

ENOUGH_POINTS = 5
"""Least number of points of an object that counts as seen.

KITTI's easy objects and nuScenes's filter of empty boxes ask for a few points alike."""


def per_object(objects: CountedObjects, seen: SurfaceCells) -> pd.DataFrame:
    """Measure what is seen of every object, in their order.

    Columns frame, object_id, class, points, cells, and length, width and height observed: from the
    first to the last cell hit along each axis of the object, metres, at most its size."""
    geometry = objects.geometry
    slices = slices_of(geometry, objects.cell)
    spans = objects.cell * _spans(seen.offsets, seen.cells, slices)
    table = objects.table[["frame", "object_id", "class"]].assign(
        points=seen.points, cells=seen.counts()
    )
    table[list(SIZE)] = np.minimum(spans, geometry[:, 3:6])
    return table


def baselines(objects: CountedObjects, seen: SurfaceCells) -> pd.DataFrame:
    """Return means over the objects of every class, index `class`.

    Columns: log_points, ln(1 + points); enough_points, share of objects with `ENOUGH_POINTS` or
    more; log_cells, ln(1 + cells); length, width and height, share of the object's that is
    observed."""
    table = per_object(objects, seen)
    size = objects.geometry[:, 3:6]
    measures = table[["class"]].assign(
        log_points=np.log1p(table["points"]),
        enough_points=table["points"] >= ENOUGH_POINTS,
        log_cells=np.log1p(table["cells"]),
    )
    spans, none = table[list(SIZE)].to_numpy(np.float64), np.zeros(size.shape)
    measures[list(SIZE)] = np.divide(spans, size, out=none, where=size > 0)
    return measures.groupby("class").mean()


@njit(cache=True, nogil=True)
def _spans(offsets, cells, slices):
    """Return slices from the first to the last one hit along each axis; 0 where nothing is hit."""
    spans = np.zeros((len(slices), 3))
    for b in range(len(slices)):
        low, high = slices[b].copy(), np.full(3, -1)
        for n in range(offsets[b], offsets[b + 1]):
            whole = np.int64(cells[n])
            for axis in (2, 1, 0):
                slice_number = whole % slices[b, axis]
                whole //= slices[b, axis]
                low[axis], high[axis] = min(low[axis], slice_number), max(high[axis], slice_number)
        for axis in range(3):
            spans[b, axis] = max(0, high[axis] - low[axis] + 1)
    return spans
