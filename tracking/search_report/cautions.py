"""Cautions about the result of a search."""

from math import dist

import numpy as np

from lidarplace.mounting.polygon import nearest_of_boundary
from tracking.findings.evidence import ray_counting_caution
from tracking.run_folders.search import SearchFolder
from tracking.run_folders.search_json import Rig, Zone
from tracking.search_report.headline import best_of_peers, with_unit

FEW_PER_PARAMETER = 10  # fewer evaluations for each parameter are few
_NEAR = 0.005  # metres: nearer to the face of a zone than any bracket is mounted
_SHARE = 0.01  # of the span of an angle


def cautions(run: SearchFolder) -> list[str]:
    """List the cautions, a sentence each."""
    search, bound = run.search, run.search.bound
    best, most = (bound.best_value, bound.value) if bound else (None, None)
    sentences = []
    if best is not None and most is not None and best > most:
        sentences.append(
            "The best rig is above the upper bound. The bound holds only for the grid of candidate "
            "mounts, and the search places LiDARs between them. A finer grid raises the bound."
        )
    sentences += [*_against_baseline(run), *_other_cases(run)]
    if search.best and (edges := at_the_edge(search.rigs[search.best[0]], search.zones)):
        sentences.append(
            f"{search.best[0]} is at the edge of what was allowed ({'; '.join(edges)}): wider "
            "ranges may hold a better rig."
        )
    if search.evaluations < FEW_PER_PARAMETER * search.parameters:
        sentences.append(
            f"{search.evaluations:,} evaluations are few for {search.parameters} parameters: "
            "another seed may find another rig."
        )
    if search.linear_share is not None:
        sentences += ray_counting_caution(search.linear_share)
    sentences += search.cautions
    failed = int((run.trials["state"] == "FAIL").sum())
    if failed:
        sentences.append(f"{failed:,} of {len(run.trials):,} trials failed.")
    return sentences


def _against_baseline(run: SearchFolder) -> list[str]:
    search = run.search
    if not search.best or not search.baseline:
        return []
    base, best = (search.rigs[n].value(search.first) for n in (search.baseline, search.best[0]))
    if not search.first.sign * (best - base) <= 0:
        return []
    most = max((zone.z[1] for zone in search.zones), default=np.inf)
    high = any(mount.z > most for mount in search.rigs[search.baseline].placed)
    rack = ", whose LiDARs are higher than the zones allow" if high else ""
    return [f"The best rig is not better than {search.baseline}{best_of_peers(search)}{rack}."]


def _other_cases(run: SearchFolder) -> list[str]:
    """Say where the baseline is better than the best rig once something differs from the design."""
    search, rows = run.search, run.robustness
    if rows is None or rows.empty or not search.best or not search.baseline:
        return []
    best, base = search.best[0], search.baseline
    lost = []
    for objective in search.objectives:
        rigs = rows[(rows["objective"] == objective.name) & (rows["case"] != "as designed")]
        # LiDARs of two rigs do not correspond: the worst failure of each is compared.
        case = rigs["case"].str.replace(r"^LiDAR \d+ fails$", "its worst LiDAR fails", regex=True)
        worst = (objective.sign * rigs["value"]).groupby([rigs["rig"], case], sort=False).min()
        for name, value in worst.get(best, default=worst[:0]).items():
            peer = worst.get((base, name), default=float("nan"))
            if peer > value:
                values = (with_unit(objective, objective.sign * v) for v in (peer, value))
                lost.append(f"{name}, {objective.name} {' against '.join(values)}")
    if not lost:
        return []
    return [f"{base} is better than {best} in other cases ({'; '.join(lost)})."]


def at_the_edge(rig: Rig, zones: tuple[Zone, ...]) -> list[str]:
    """Name what is at the edge of its range, for example "LiDAR 2: z, roll".

    LiDARs outside of `zones` were not searched, or are mirror images; a range without width and
    a full turn have no edge."""
    by_name = {zone.name: zone for zone in zones}
    lidars_at_edge = []
    lidars = zip(rig.placed, rig.zones, rig.models, strict=True)
    for i, (mount, name, model) in enumerate(lidars, start=1):
        zone = by_name.get(name or "")
        if zone is None or mount.y < min(y for _, y in zone.polygon) - _NEAR:
            continue
        edges, (low, high), at = [], zone.z, (mount.x, mount.y)
        angles = zone.models.get(model, zone)
        if len(zone.polygon) > 2 and dist(nearest_of_boundary(zone.polygon, *at), at) < _NEAR:
            edges.append("x, y")
        if high > low and min(abs(mount.z - low), abs(mount.z - high)) < _NEAR:
            edges.append("z")
        edges += [
            angle
            for angle in ("roll", "pitch", "yaw")
            if _extreme(np.degrees(getattr(mount, angle)), getattr(angles, f"{angle}_deg"))
        ]
        if edges:
            lidars_at_edge.append(f"LiDAR {i}: {', '.join(edges)}")
    return lidars_at_edge


def _extreme(degrees: float, span: tuple[float, float]) -> bool:
    low, high = span
    if not low < high < low + 360:
        return False
    off = abs((degrees - (low + high) / 2 + 180) % 360 - 180)  # from the middle, either way round
    return off > (0.5 - _SHARE) * (high - low)
