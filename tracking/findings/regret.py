"""What does it cost to take the placement that a surrogate says is best?"""

import numpy as np
import pandas as pd

from lidarplace.pog.surrogates.table import SURROGATES
from tracking.findings.best_placement import BestPlacement
from tracking.labels import some
from tracking.statistics.regret import expected_regret

AT_RANDOM = "a placement at random"


def regrets(best: BestPlacement, surrogates: pd.DataFrame) -> pd.DataFrame:
    """By how much the choice of each surrogate is below the best placement.

    A surrogate chooses among the placements that have it and the metric: its highest value, or its
    lowest where that is best; of equal ones any.

    Args:
        best: `best_placement` of the metric.
        surrogates: placements as rows, surrogates as columns
            (`tracking.findings.summary.surrogates_of`).

    Returns:
        One row a surrogate with two different values, then one of `AT_RANDOM`: surrogate; takes,
        "highest" or "lowest"; choice; behind, the mean of the choice below the highest mean, as
        measured: too much on average, since the highest is partly the luckiest; regret, its
        expectation when that is allowed for (`tracking.statistics.regret`), and low and high, 95 %.
    """
    names, means = [str(name) for name in best.sure.index], best.means
    rows, choices = [], []
    for surrogate in surrogates.columns:
        values = surrogates[surrogate].reindex(names).dropna()
        if values.nunique() < 2:
            continue
        known = SURROGATES.get(str(surrogate))
        lowest = known is not None and known.direction == "minimize"
        chosen = values.index[values == (values.min() if lowest else values.max())]
        choices.append(np.isin(names, chosen) / len(chosen))
        rows.append(
            {
                "surrogate": str(surrogate),
                "takes": "lowest" if lowest else "highest",
                "choice": some(list(chosen)),
            }
        )
    rows.append({"surrogate": AT_RANDOM, "takes": "any", "choice": ""})
    choices.append(np.full(len(names), 1 / len(names)))
    weights = np.stack(choices)
    expected = expected_regret(means, best.noise, weights)
    return pd.DataFrame(rows).assign(
        behind=means.max() - weights @ means,
        regret=expected[:, 0],
        low=expected[:, 1],
        high=expected[:, 2],
    )
