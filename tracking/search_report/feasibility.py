"""Constraints that the trials of a search kept, and how near the nearest trial came."""

import pandas as pd

from tracking.labels import DASH, digits
from tracking.pages.section import Table
from tracking.run_folders.search import SearchFolder


def excess(run: SearchFolder) -> pd.DataFrame:
    """Compute how far trials break constraints, in shares of the limits.

    Rows are possible trials with every violation known, columns constraints. A limit of 0 counts
    in its own unit. Of equals the one is nearer that has enough at more positions."""
    trials, columns = run.trials[run.trials["possible"].astype(bool)], {}
    for c in run.search.constraints:
        lacks = 1 - trials.get(f"enough.{c.name}", 1.0)
        columns[c.name] = trials[f"violation.{c.name}"] / (abs(c.limit) or 1) * (1 + 1e-3 * lacks)
    return pd.DataFrame(columns, index=trials.index).dropna().clip(lower=0)


def nearest_trial(run: SearchFolder) -> pd.Series | None:
    """Find the trial with the smallest sum of `excess`; None without trials."""
    over = excess(run)
    if over.empty:
        return None
    least = over.sum(axis=1).sort_values(kind="stable").index[:1]
    return run.trials.loc[least].iloc[0]


def nothing_found(run: SearchFolder) -> str:
    """Say in a line that no rig was found: which requirements none meets, and the closest trial."""
    over, sentences = excess(run), []
    for c in run.search.constraints:
        if c.name.startswith("requirement.") and len(over) and over[c.name].min() > 0:
            closest = run.trials.loc[[over[c.name].idxmin()]].iloc[0]
            enough = closest.get(f"enough.{c.name}")
            has = amount(c.limit - closest[f"violation.{c.name}"])
            where = "" if enough is None else f"; {100 * enough:.0f} % of the positions have enough"
            sentences.append(
                f"No rig meets the requirement {c.name.partition('.')[2]!r}: the closest, trial "
                f"{closest['number']}, has {has} of {amount(c.limit, c.unit)}{where}"
            )
    if sentences:
        return ". ".join(sentences)
    any_feasible = run.trials["feasible"].astype(bool).any()
    return "No rig with a value" if any_feasible else "No rig keeps all constraints"


def infeasible_sentences(run: SearchFolder) -> list[str]:
    """Say why no rig was found: LiDARs in one place, the nearest trial, what it breaks."""
    trials, count, limits = run.trials, len(run.trials), run.search.constraints
    possible = trials[trials["possible"].astype(bool)]
    clashes = count - len(possible)
    feasible = int(trials["feasible"].astype(bool).sum())
    if not count:
        return ["No trial was evaluated."]
    if not len(possible):
        return [f"All {count:,} trials put two LiDARs in one place."]
    if feasible:
        return [f"{feasible:,} of {count:,} trials kept every constraint, but none has a value."]
    sentences = [
        f"{clashes:,} of {count:,} trials put two LiDARs in one place, and none of the others kept "
        "every constraint."
        if clashes
        else f"None of {count:,} trials kept every constraint."
    ]
    nearest = nearest_trial(run)
    if nearest is None:
        return sentences
    over = excess(run).loc[[nearest.name]].iloc[0].sort_values()
    by_name = {constraint.name: constraint for constraint in limits}
    parts = [
        f"{c.name} by {amount(nearest[f'violation.{c.name}'], c.unit)} "
        f"({c.sense} {amount(c.limit, c.unit)})"
        for c in (by_name[str(name)] for name in over.index[over > 0])
    ]
    if parts:
        sentences.append(
            f"Closest, relative to the limits, is trial {nearest['number']}. It breaks "
            f"{', '.join(parts)}{'; the least broken first' if len(parts) > 1 else ''}."
        )
    parts = [
        f"{c.name}, which the best of them broke by {amount(least, c.unit)}"
        for c in limits
        if (least := possible[f"violation.{c.name}"].min()) > 0
    ]
    if parts:
        sentences.append(f"No {'other ' if clashes else ''}trial kept {', nor '.join(parts)}.")
    else:
        sentences.append("Each one was kept by some trial, but no trial kept all.")
    return sentences


def constraint_table(run: SearchFolder) -> Table:
    """Show limits, measures of the best rig and the baseline, and how often trials broke limits."""
    search = run.search
    names = list(dict.fromkeys(filter(None, (*search.best[:1], search.baseline))))
    head = ("constraint", "limit", *names, "broken by trials")
    rows = tuple(
        (
            constraint.name,
            f"{constraint.sense} {amount(constraint.limit, constraint.unit)}",
            *(amount(search.rigs[name].measures.get(constraint.name)) for name in names),
            _broken(run.trials[f"violation.{constraint.name}"].dropna()),
        )
        for constraint in search.constraints
    )
    return Table("Limits and measures", head, rows, words=frozenset({0, 1}), wide=True)


def _broken(violation: pd.Series) -> str:
    if violation.empty:
        return DASH
    count = int((violation > 0).sum())
    return f"{count:,} of {len(violation):,} ({100 * count / len(violation):.0f} %)"


def amount(value: float | None, unit: str = "") -> str:
    """Format a value that keeps no more digits than it has, with its unit; a dash for None."""
    if value is None:
        return DASH
    return f"{digits(value, ',.3g' if abs(value) < 1e3 else ',.0f')} {unit}".rstrip()
