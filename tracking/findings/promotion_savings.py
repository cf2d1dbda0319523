"""What a promotion of placements saved: seconds spent, against full trainings of all."""

from collections.abc import Sequence

import pandas as pd

from tracking.findings.promotion import Promoted


def rung_costs(group: Promoted) -> pd.DataFrame:
    """One row a stage: stage, placements, without_value, kept, seconds, seconds_each.

    `seconds_each` is the mean over placements; the full training counts all seeds of one, and
    keeps none. Seconds of rungs are of their own tasks alone.
    """
    *names, last = group.stages
    rows = []
    for name, (_, part) in zip(names, group.rungs.groupby("rung"), strict=True):
        rows.append(
            {
                "stage": name,
                "placements": len(part),
                "without_value": int(part["value"].isna().sum()),
                "kept": int(part["kept"].sum()),
                "seconds": part["seconds"].sum(),
                "seconds_each": part["seconds"].mean(),
            }
        )
    reached = int(group.rungs.loc[group.rungs["rung"] == group.rungs["rung"].max(), "kept"].sum())
    trained = group.trials["placement"].nunique()
    rows.append(
        {
            "stage": last,
            "placements": reached,
            "without_value": reached - trained,
            "kept": 0,
            "seconds": group.trials["seconds"].sum(),
            "seconds_each": group.trials["seconds"].mean() * group.seeds,
        }
    )
    return pd.DataFrame(rows)


def savings(groups: Sequence[Promoted], surrogate_axes: Sequence[str]) -> pd.DataFrame:
    """Seconds that promotion spent, against full trainings of all placements.

    Without promotion every placement of the first rung would have had the surrogates of all
    surrogate rungs and a full training for every seed, at the mean seconds of those that were
    done. Point clouds are counted on neither side.

    Args:
        surrogate_axes: axes that surrogates depend on: groups that differ in others share them.

    Returns:
        One row a group, and one for all when there are several: group, placements, surrogates,
        short, full (seconds spent), spent, without (seconds, NaN if no full training finished),
        saved (without less spent).
    """
    rows, own = [], []
    for number, group in enumerate(groups):
        is_surrogate = group.rungs["setting"] == ""
        own.append(group.rungs[is_surrogate].assign(group=number))
        rows.append(
            {
                "group": group.title,
                "placements": group.placements,
                "short": group.rungs.loc[~is_surrogate, "seconds"].sum(),
                "full": group.trials["seconds"].sum(),
                "all_full": group.trials["seconds"].mean() * group.placements * group.seeds,
            }
        )
    table = pd.DataFrame(rows)
    surrogates = pd.concat(own)
    spent = surrogates.groupby("group")["seconds"].sum()
    of_rung = surrogates.groupby(["group", "rung"])["seconds"].mean().groupby("group").sum()
    table["surrogates"] = spent.reindex(table.index, fill_value=0.0)
    table["all_surrogates"] = of_rung.reindex(table.index, fill_value=0.0) * table["placements"]
    if len(table) > 1:
        total = table.drop(columns="group").sum(skipna=False)
        depends = [axis for axis in surrogate_axes if axis in surrogates.columns]
        once = surrogates.drop_duplicates([*depends, "rung", "placement"])
        total["surrogates"] = once["seconds"].sum()
        each = once.groupby([*depends, "rung"], dropna=False)["seconds"].mean()
        total["all_surrogates"] = each.sum() * table["placements"].max()
        table.loc[len(table)] = {"group": "all groups", **total}
    table["spent"] = table["surrogates"] + table["short"] + table["full"]
    table["without"] = table["all_surrogates"] + table["all_full"]
    table["saved"] = table["without"] - table["spent"]
    columns = ["group", "placements", "surrogates", "short", "full", "spent", "without", "saved"]
    return table[columns]
