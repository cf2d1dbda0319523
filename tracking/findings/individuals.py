"""How many individuals the objects of a sweep are: a car that is in 50 frames is one car."""

import pandas as pd

MOST_FREQUENT = 10
"""Individuals whose share of the boxes is reported."""


def count_individuals(individuals: pd.DataFrame) -> pd.DataFrame:
    """Boxes and individuals of every split and class.

    Args:
        individuals: split, scene, route, class, object_id, boxes: a row an object of a route, of
            one setting of the axes.

    Returns:
        Columns split, class, routes (in which there is an object of the class), boxes,
        individuals (a road user that several routes met is one) and share_of_ten (of the boxes,
        those of the `MOST_FREQUENT` individuals that have most, in [0, 1]). Training first.
    """
    rows = []
    for (split, name), own in individuals.groupby(["split", "class"], sort=False):
        boxes = own.groupby(["scene", "object_id"])["boxes"].sum()
        rows.append(
            {
                "split": split,
                "class": name,
                "routes": len(own[["scene", "route"]].drop_duplicates()),
                "boxes": int(boxes.sum()),
                "individuals": len(boxes),
                "share_of_ten": float(boxes.nlargest(MOST_FREQUENT).sum() / boxes.sum()),
            }
        )
    columns = ["split", "class", "routes", "boxes", "individuals", "share_of_ten"]
    counts = pd.DataFrame(rows, columns=columns)
    return counts.sort_values(["split", "class"], ascending=[False, True], ignore_index=True)
