"""What a promotion of placements risked: whether its stages rank them alike."""

import numpy as np
import pandas as pd
from scipy import stats

from tracking.findings.promotion import Promoted, stage_ranks
from tracking.findings.surrogate_accuracy import rank_agreement
from tracking.statistics.permutation import LARGEST_EXACT, permutation_p

COLUMNS = (
    *("rung", "earlier", "later", "to_full", "n", "spearman", "spearman_p", "kendall", "kendall_p"),
    *("best", "best_rank", "ranked", "kept", "first", "first_rank", "regret", "seconds"),
)


def agreement(group: Promoted) -> pd.DataFrame:
    """How each stage ranked the placements that a later stage ranked too.

    Pairs of neighbouring rungs, and of each rung and the full training. Only placements that
    reached the later stage have both ranks. They were chosen by the earlier one, so their range is
    restricted: the agreement among them says little about the placements that were pruned.

    Returns:
        One row a pair: rung, the number of the earlier one from 1; earlier, later (names of
        stages); to_full, whether the later one is the full training; n placements with both;
        spearman, spearman_p, kendall, kendall_p (NaN for fewer than 3; see `_p_values`); best, of
        the later stage, and best_rank, its rank among all of the earlier one; ranked and kept, by
        the earlier stage; first, what the earlier stage ranked highest of the n, and first_rank,
        its rank there; regret, how much worse `first` is than `best` in the later stage, in its
        own unit; seconds, mean of the earlier stage for a placement.
    """
    ranks = stage_ranks(group)
    last = len(group.stages) - 1
    values = [part.set_index("placement")["value"] for _, part in group.rungs.groupby("rung")]
    kept = group.rungs.groupby("rung")["kept"].sum().tolist()
    seconds = group.rungs.groupby("rung")["seconds"].mean().tolist()
    rows = []
    for i in range(last):
        for j in dict.fromkeys((i + 1, last)):
            both = ranks.iloc[:, [i, j]].dropna()
            if both.empty:
                continue
            earlier, later = (both.iloc[:, k] for k in (0, 1))
            best, first = str(later.idxmin()), str(earlier.idxmin())
            value = group.ap if j == last else values[j]
            rho, tau = rank_agreement(earlier, later)
            p_spearman, p_kendall = _p_values(earlier, later)
            rows.append(
                {
                    "rung": i + 1,
                    "earlier": group.stages[i],
                    "later": group.stages[j],
                    "to_full": j == last,
                    "n": len(both),
                    "spearman": rho,
                    "spearman_p": p_spearman,
                    "kendall": tau,
                    "kendall_p": p_kendall,
                    "best": best,
                    "best_rank": int(earlier[best]),
                    "ranked": int(ranks.iloc[:, i].notna().sum()),
                    "kept": int(kept[i]),
                    "first": first,
                    "first_rank": int(earlier[first]),
                    "regret": abs(value[best] - value[first]),
                    "seconds": seconds[i],
                }
            )
    return pd.DataFrame(rows, columns=COLUMNS)


def _p_values(a: pd.Series, b: pd.Series) -> tuple[float, float]:
    """Two-sided p-values of Spearman's rho and Kendall's tau; NaN for fewer than 3 or equal ones.

    From all permutations up to `LARGEST_EXACT` pairs. Beyond, thousands of placements may have
    both ranks: then scipy's, of rho by the t distribution, of tau exact or by the normal one.
    """
    if len(a) < 3 or a.nunique() == 1 or b.nunique() == 1:
        return np.nan, np.nan
    if len(a) > LARGEST_EXACT:
        return float(stats.spearmanr(a, b).pvalue), float(stats.kendalltau(a, b).pvalue)
    one, other = a.to_numpy()[None], b.to_numpy()
    return (
        float(permutation_p(one, other, "spearman")[0]),
        float(permutation_p(one, other, "kendall")[0]),
    )
