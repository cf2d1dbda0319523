"""What to be careful about when reading the result of a search."""

from __future__ import annotations

from tracking.search_folder import SearchFolder
from tracking.search_report.edges import at_the_edge

FEW_PER_PARAMETER = 10
"""Fewer evaluations for each varied parameter are few."""


def cautions(run: SearchFolder) -> list[str]:
    """Sentences, none if there is nothing to say."""
    search = run.search
    found = [*_bound(run), *_against_baseline(run)]
    if search.best:
        edges = at_the_edge(search.rigs[search.best[0]], search.zones, run.trials)
        if edges:
            found.append(
                f"{search.best[0]} is at the edge of what was allowed or tried "
                f"({'; '.join(edges)}): wider ranges may hold a better rig."
            )
    varied = varied_parameters(run)
    if varied and search.evaluations < FEW_PER_PARAMETER * varied:
        found.append(
            f"{search.evaluations:,} evaluations are few for {varied} varied parameters: another "
            "seed may find another rig."
        )
    failed = int((run.trials["state"] == "FAIL").sum())
    if failed:
        found.append(f"{failed:,} of {len(run.trials):,} trials failed.")
    return found


def varied_parameters(run: SearchFolder) -> int:
    """How many columns of the trials hold parameters that took more than one value."""
    return sum(
        run.trials[column].nunique() > 1
        for column in run.trials.columns
        if column.startswith(("lidar_", "param."))
    )


def _bound(run: SearchFolder) -> list[str]:
    bound = run.search.bound
    if bound is None or bound.value is None or bound.best_value is None:
        return []
    if bound.best_value <= bound.value:
        return []
    return [
        "The best rig is above the upper bound. This is no contradiction: the bound holds for the "
        "grid of candidate mounts, and the search places LiDARs between them. A finer grid "
        "raises the bound."
    ]


def _against_baseline(run: SearchFolder) -> list[str]:
    search = run.search
    if not search.best or not search.baseline:
        return []
    base, best = (search.rigs[n].value(search.first) for n in (search.baseline, search.best[0]))
    gain = search.first.sign * (best - base)
    if gain <= 0:
        return [
            f"The best rig is not better than {search.baseline}, the best of the paper's eight."
        ]
    error = search.stride.relative_error if search.stride else None
    if error is not None and gain < error * abs(best):
        return [
            f"The gain over {search.baseline} is smaller than the error of firing fewer azimuth "
            "steps."
        ]
    return []
