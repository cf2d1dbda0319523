"""How many points the objects of a class get, by their distance."""

import pandas as pd

from lidarplace.base.rings import bounds_of, ring_of

COLUMNS = ("class", "from_m", "to_m", "objects", "mean", "median", "p10", "unseen")


def points_by_distance(objects: pd.DataFrame, points: pd.DataFrame) -> pd.DataFrame:
    """Points per object of every class in every ring around the vehicle.

    Args:
        objects: ground truth with frame, object_id, class, x, y; ego frame, metres.
        points: `count_points_per_object`: frame, object_id, points. Objects of frames that it does
            not have are left out.

    Returns:
        Columns class, from_m, to_m (bounds of the ring), objects (their number), mean, median and
        p10 (of the points on an object; a tenth of the objects have p10 or fewer), unseen (share
        of the objects without a point, in [0, 1]). Rings without objects have no row.
    """
    found = objects.merge(points, on=["frame", "object_id"])
    grouped = found.assign(ring=ring_of(found)).groupby(["class", "ring"], observed=True)["points"]
    table = grouped.agg(
        objects="size",
        mean="mean",
        median="median",
        p10=lambda values: values.quantile(0.1),
        unseen=lambda values: (values == 0).mean(),
    ).reset_index()
    bounds = [bounds_of(ring) for ring in table.pop("ring")]
    table["from_m"] = [low for low, _ in bounds]
    table["to_m"] = [high for _, high in bounds]
    return table[list(COLUMNS)]
