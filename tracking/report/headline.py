"""The first lines of a report: which placement, by how much and how sure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from lidarplace.base.metrics import headline_metric
from tracking import labels
from tracking.findings.best_placement import BestPlacement, best_placement
from tracking.findings.evidence import Weakness, grade, weaknesses
from tracking.findings.groups import ONE_FOR_ALL, Group
from tracking.findings.summary import deciding_surrogate, surrogates_of
from tracking.kitti_iou import headline_iou, judged
from tracking.run_folders.sweep import RunFolder


@dataclass(frozen=True)
class Verdict:
    """What a group says about one class, as sentences.

    Attributes:
        what: what the placement is first in, such as "Best for Car".
        group: title of the group, "" if there is no other.
        best: the placement, or several that are equal, or that there is none.
        lead: its value, and how far it is ahead of which.
        sure: how sure that is; no surer than the heaviest of `weaknesses`, the first.
    """

    what: str
    group: str
    metric: str
    best: str
    lead: str
    sure: str
    weaknesses: tuple[Weakness, ...] = ()

    @property
    def heading(self) -> str:
        """What, and in which group."""
        return f"{self.what} · {self.group}" if self.group else self.what


def verdicts(run: RunFolder, group: Group, ranked: Mapping[str, BestPlacement]) -> list[Verdict]:
    """One for every class that has AP, and for the recall of all; `ranked`: `headline_ranking`."""
    found, every = [], weaknesses(run, group)
    for name, best in ranked.items():
        weak = tuple(own for own in every if name in own.classes)
        what = f"{'Highest mean' if weak else 'Best'} for {class_label(name)}"
        of, metric = group.title if group.varies else "", headline_label(run.results, name)
        lead, sure = _lead(best), _sure(best, weak)
        found.append(Verdict(what, of, metric, labels.some(best.equal), lead, sure, weak))
    return found


def class_label(object_class: str) -> str:
    """How a class is called in a heading."""
    return "all objects" if object_class == "all" else object_class


def headline_label(results: pd.DataFrame, object_class: str) -> str:
    """The headline metric of a class and its IoU in `results`, "BEV AP @ 0.7"."""
    return labels.metric_label(headline_metric(object_class), headline_iou(results, object_class))


def headline_ranking(run: RunFolder, group: Group) -> dict[str, BestPlacement]:
    """`best_placement` of headline AP for every class that has any, and of recall for "all"."""
    found = {}
    for name in (*run.classes, "all"):
        own, left_out = judged(group.of(run.results), run.results, name), None
        if run.left_out is not None:
            left_out = judged(group.of(run.left_out), run.results, name)
        best = best_placement(own, left_out=left_out, generalist=group.evaluator in ONE_FOR_ALL)
        if best is not None:
            found[name] = best
    return found


def _lead(best: BestPlacement) -> str:
    text = f"{labels.plus_minus(best.mean, np.nan)} %"
    if best.others.empty:
        return text
    second = best.others.iloc[0]
    if second["lead"] == 0:
        return f"{text}, the same for {len(best.equal)} of {len(best.sure)} placements"
    text += f", {second['lead']:.1f} points ahead of {best.others.index[0]}"
    if np.isfinite(second["low"]):
        text += f" (95 % CI {labels.span(second['low'], second['high'], 'z.1f')})"
        text += labels.not_significant(second["low"], second["high"])
    return text


def _sure(best: BestPlacement, weak: Sequence[Weakness]) -> str:
    """How sure it is that the best is the best."""
    if best.others.empty:
        return "No other placement."
    if weak:
        return grade(weak)
    if len(best.equal) > 1:
        return "No placement is ahead."
    sure = f"{labels.percent(best.sure.iloc[0])} likely to be the best of {len(best.sure)}"
    if not best.tied:
        return f"{sure}, and significantly better than all others."
    return f"{sure}; not significantly better than {labels.some(best.tied)}."


def surrogate_verdicts(run: RunFolder, group: Group) -> list[Verdict]:
    """One verdict for every class of a sweep without results, by `deciding_surrogate`."""
    decides = deciding_surrogate(run.surrogates)
    found, by = [], labels.surrogate_name(decides)
    for name in run.classes:
        table = surrogates_of(run.surrogates, group.setting, name)
        if decides not in table.columns or not table[decides].notna().any():
            continue
        ranked = table[decides].dropna().sort_values(ascending=False, kind="stable")
        best, unit = str(ranked.index[0]), labels.surrogate_unit(decides)
        lead = f"{ranked.iloc[0]:,.5g} {unit}"
        # Sums of the same terms in another order differ by rounding.
        level = len(ranked) > 1 and np.allclose(ranked, ranked.iloc[0], rtol=1e-9, atol=0)
        if level:
            lead += f" for all {len(ranked):,} placements"
        elif len(ranked) > 1 and ranked.iloc[1] > 0:
            ahead = 100 * (ranked.iloc[0] / ranked.iloc[1] - 1)
            lead += f", {ahead:.2g} % ahead of {ranked.index[1]}, of {len(ranked):,} placements"
        nothing = "h_pog" in table.columns and bool((table["h_pog"] == 0).all())
        why = f"H_POG is 0: no {name} was seen, or always in the same voxels." if nothing else ""
        ahead_of = "no placement is ahead" if level else best
        what, of = f"Highest {by} for {name}", group.title * group.varies
        found.append(Verdict(what, of, by, ahead_of, lead, why))
    return found
