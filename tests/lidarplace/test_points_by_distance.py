"""Points per object by distance."""

import numpy as np
import pandas as pd

from lidarplace.clouds.points_by_distance import COLUMNS, points_by_distance


def test_against_a_loop():
    rng = np.random.default_rng(0)
    rows = 300
    objects = pd.DataFrame(
        {
            "frame": np.repeat(np.arange(30), 10),
            "object_id": np.tile(np.arange(10), 30),
            "class": rng.choice(["Car", "Cyclist"], rows),
            "x": rng.uniform(-70, 70, rows),
            "y": rng.uniform(-20, 20, rows),
        }
    )
    points = objects[["frame", "object_id"]].assign(points=rng.poisson(3, rows))
    points = points[points["frame"] < 25].sample(frac=1, random_state=1)
    table = points_by_distance(objects, points)
    count = {(r.frame, r.object_id): r.points for r in points.itertuples()}
    for row in table.itertuples():
        own = [
            count[r.frame, r.object_id]
            for r in objects[objects["frame"] < 25].itertuples()
            if r._3 == table.loc[row.Index, "class"] and row.from_m <= np.hypot(r.x, r.y) < row.to_m
        ]
        assert row.objects == len(own)
        assert row.mean == np.mean(own)
        assert row.median == np.median(own)
        assert row.p10 == np.quantile(own, 0.1)
        assert row.unseen == np.mean(np.array(own) == 0)
    assert table["objects"].sum() == 250


def test_no_objects():
    objects = pd.DataFrame(
        {"frame": [0], "object_id": [1], "class": ["Car"], "x": [1.0], "y": [0.0]}
    )
    points = pd.DataFrame({"frame": [1], "object_id": [1], "points": [7]})
    table = points_by_distance(objects, points)
    assert table.empty
    assert tuple(table.columns) == COLUMNS
