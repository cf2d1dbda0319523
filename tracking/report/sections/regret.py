"""Regret: what it costs to take the placement that a surrogate ranks first."""

import numpy as np
import pandas as pd

from lidarplace.base.metrics import headline_metric
from lidarplace.pog.surrogates.table import DECIDING, HEADLINE_SURROGATES, SURROGATES
from tracking.findings.best_placement import BestPlacement
from tracking.findings.generalist import JUDGEMENTS
from tracking.findings.summary import surrogates_of
from tracking.kitti_iou import headline_iou
from tracking.labels import some
from tracking.pages.section import METRIC, SURROGATE, Table, in_points, numbers, words
from tracking.report.analysis import Analysis
from tracking.statistics.posterior import expected_regret

MOST_CHOICES = 100  # rows that the page shows


def regret_table(analysis: Analysis) -> list[Table]:
    """Show the regret of all groups and classes; [] where there is no choice or no surrogate."""
    table = regrets_of_all(analysis)
    if table.empty:
        return []
    columns = [
        words("class"),
        *([words("detector", "group")] if table["group"].nunique() > 1 else []),
        METRIC,
        SURROGATE,
        words("takes the", "takes"),
        words("choice"),
        numbers("below the highest mean (points)", "behind", "z.1f"),
        in_points("expected regret (points)", ("regret", "low", "high"), "z.1f"),
    ]
    caption = "Regret: what the choice of each surrogate loses"
    units = dict.fromkeys(("behind", "regret", "low", "high"), "points")
    return [Table.of(caption, table, columns, units, name="regret").first(MOST_CHOICES)]


def regrets_of_all(analysis: Analysis) -> pd.DataFrame:
    """Compute `regrets` of every group and class, with class, group, its place, metric and IoU.

    Left out where no placement is better than another."""
    run, parts = analysis.run, []
    summed = analysis.summed_surrogates
    for ranked in analysis.rankings:
        group = ranked.group
        for name, best in ranked.ranking.items():
            of_class = surrogates_of(summed, group.place, name)
            # With a first choice of their own, which covered entropy has: the opposite of S-MIG's.
            choose = dict.fromkeys((*JUDGEMENTS, *DECIDING, *HEADLINE_SURROGATES))
            named = [s for s in choose if s in of_class.columns]
            if not named or len(best.equal) == len(best.sure):
                continue
            place = {"class": name, "group": group.title, **group.place}
            place |= {"metric": headline_metric(name), "iou": headline_iou(run.results, name)}
            lost = regrets(best, of_class[named])
            parts.append(pd.DataFrame([place] * len(lost)).join(lost))
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()


AT_RANDOM = "a placement at random"


def regrets(best: BestPlacement, surrogates: pd.DataFrame) -> pd.DataFrame:
    """Compute how far the choice of each surrogate is below the best placement, `best`.

    A surrogate chooses among the placements that have it and the metric: its highest value, or its
    lowest where that is best; of equal ones any. `surrogates` are those of `surrogates_of`.

    One row a surrogate with two different values, then one of `AT_RANDOM`: surrogate; takes,
    "highest" or "lowest"; choice; behind, the mean of the choice below the highest mean, as
    measured: too much on average, since the highest is partly the luckiest; regret, its
    expectation when that is allowed for (`expected_regret`), and low and high, 95 %."""
    names, means = [str(name) for name in best.sure.index], best.means
    rows, choices = [], []
    for surrogate in surrogates.columns:
        values = surrogates[surrogate].reindex(names).dropna()
        if values.nunique() < 2:
            continue
        definition = SURROGATES.get(str(surrogate))
        lowest = definition is not None and definition.direction == "minimize"
        chosen = values.index[values == (values.min() if lowest else values.max())]
        choices.append(np.isin(names, chosen) / len(chosen))
        rows.append((str(surrogate), "lowest" if lowest else "highest", some(list(chosen))))
    rows.append((AT_RANDOM, "any", ""))
    choices.append(np.full(len(names), 1 / len(names)))
    weights = np.stack(choices)
    table = pd.DataFrame(rows, columns=["surrogate", "takes", "choice"])
    table["behind"] = means.max() - weights @ means
    table[["regret", "low", "high"]] = expected_regret(means, best.noise, weights)
    return table
