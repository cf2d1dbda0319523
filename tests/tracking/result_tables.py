"""Results and surrogates of a made-up sweep, from arrays."""

import pandas as pd


def tables(x, y, object_class="Car", surrogate="s_mig", metric="AP_R40_3D"):
    """`x` (n,) and `y` (n, seeds) as the tables of a run."""
    keys = {"class": object_class, "detector": "d", "metric": metric, "iou": 0.7}
    rows = [(f"p{i}", s, value) for i, row in enumerate(y) for s, value in enumerate(row)]
    results = pd.DataFrame(rows, columns=["placement", "seed", "value"])
    results = results.assign(**keys, difficulty="all", ground_truths=500)
    surrogates = pd.DataFrame({"placement": [f"p{i}" for i in range(len(x))], "value": x})
    return results, surrogates.assign(**{"class": object_class, "surrogate": surrogate})
