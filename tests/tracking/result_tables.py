"""Results and surrogates of a made-up sweep, from arrays."""

import pandas as pd


def tables(x, y, object_class="Car", surrogate="s_mig", metric="AP_R40_3D"):
    """`x` (n,) and `y` (n, seeds) as the tables of a run."""
    results = [
        {
            "placement": f"p{i}",
            "class": object_class,
            "detector": "d",
            "seed": s,
            "metric": metric,
            "iou": 0.7,
            "difficulty": "all",
            "value": value,
            "ground_truths": 500,
        }
        for i, row in enumerate(y)
        for s, value in enumerate(row)
    ]
    surrogates = [
        {"placement": f"p{i}", "class": object_class, "surrogate": surrogate, "value": value}
        for i, value in enumerate(x)
    ]
    return pd.DataFrame(results), pd.DataFrame(surrogates)
