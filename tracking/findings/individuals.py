"""Number of individuals among the objects of a sweep: a car that is in 50 frames is one car."""

import pandas as pd

MOST_FREQUENT = 10  # individuals whose share of the boxes is reported


def count_individuals(individuals: pd.DataFrame) -> pd.DataFrame:
    """Count boxes and individuals of every split and class, training first, at one setting of axes.

    Columns split, class, routes (with an object of the class), boxes, individuals (a road user that
    several routes met is one) and share_of_ten (of the boxes, those of the `MOST_FREQUENT`
    individuals that have most, in [0, 1])."""
    rows = []
    for key, objects in individuals.groupby(["split", "class"], sort=False):
        boxes = objects.groupby(["scene", "object_id"])["boxes"].sum()
        routes, whole = len(objects[["scene", "route"]].drop_duplicates()), int(boxes.sum())
        most = float(boxes.nlargest(MOST_FREQUENT).sum() / whole)
        rows.append((*key, routes, whole, len(boxes), most))
    columns = ["split", "class", "routes", "boxes", "individuals", "share_of_ten"]
    counts = pd.DataFrame(rows, columns=columns)
    return counts.sort_values(["split", "class"], ascending=[False, True], ignore_index=True)
