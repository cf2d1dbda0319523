"""Headlines of a report: the best placement, by how much, and how certain that is."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from lidarplace.base.metrics import headline_metric
from tracking import labels
from tracking.findings.best_placement import BestPlacement, best_placement
from tracking.findings.evidence import Weakness, grade
from tracking.findings.groups import ONE_FOR_ALL, Group
from tracking.findings.summary import deciding_surrogate, surrogates_of
from tracking.kitti_iou import at_headline_iou, headline_iou
from tracking.run_folders.sweep import RunFolder


@dataclass(frozen=True)
class Statement:
    """Headline about one class in one group, as sentences.

    Attributes:
        title: what the placement is first in, such as "Best for Car".
        group: title of the group, "" if there is no other.
        metric: name of the metric.
        best: the placement, or several that are equal, or that there is none.
        lead: its value, and how far it is ahead of which.
        certainty: how certain that is, as far as the heaviest of `weaknesses`, the first, allows.
        weaknesses: of the evidence, the heaviest first."""

    title: str
    group: str
    metric: str
    best: str
    lead: str
    certainty: str
    weaknesses: tuple[Weakness, ...] = ()

    @property
    def heading(self) -> str:
        """Title, with the group if there are several."""
        return f"{self.title} · {self.group}" if self.group else self.title


def statements(
    run: RunFolder,
    group: Group,
    ranking: Mapping[str, BestPlacement],
    weaknesses: Sequence[Weakness],
) -> dict[str, Statement]:
    """Make the headline of each class that has AP, and of the recall of all.

    `ranking` is `headline_ranking` of the group, `weaknesses` are those of its evidence."""
    by_class = {}
    for name, best in ranking.items():
        weak = tuple(weakness for weakness in weaknesses if name in weakness.classes)
        by_class[name] = Statement(
            title=f"{'Highest mean' if weak else 'Best'} for {class_label(name)}",
            group=group.title if group.varies else "",
            metric=headline_label(run.results, name),
            best=labels.some(best.equal),
            lead=_lead(best),
            certainty=_certainty(best, weak),
            weaknesses=weak,
        )
    return by_class


def class_label(object_class: str) -> str:
    """Name a class in a heading."""
    return "all objects" if object_class == "all" else object_class


def headline_label(results: pd.DataFrame, object_class: str) -> str:
    """Name the headline metric of a class with its IoU in `results`, such as "BEV AP @ 0.7"."""
    return labels.metric_label(headline_metric(object_class), headline_iou(results, object_class))


def headline_ranking(run: RunFolder, group: Group) -> dict[str, BestPlacement]:
    """Compare placements by headline AP of every class that has any, and by recall of "all"."""
    ranking = {}
    for name in (*run.classes, "all"):
        values, left_out = at_headline_iou(group.of(run.results), run.results, name), None
        if run.left_out is not None:
            left_out = at_headline_iou(group.of(run.left_out), run.results, name)
        best = best_placement(values, left_out=left_out, generalist=group.evaluator in ONE_FOR_ALL)
        if best is not None:
            ranking[name] = best
    return ranking


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


def _certainty(best: BestPlacement, weak: Sequence[Weakness]) -> str:
    """Say how certain it is that the best placement is the best."""
    if best.others.empty:
        return "No other placement."
    if weak:
        return grade(weak)
    if len(best.equal) > 1:
        return "No placement is ahead."
    likely = f"{labels.percent(best.sure.iloc[0])} likely to be the best of {len(best.sure)}"
    if not best.tied:
        return f"{likely}, and significantly better than all others."
    return f"{likely}; not significantly better than {labels.some(best.tied)}."


def surrogate_statements(run: RunFolder, group: Group) -> list[Statement]:
    """Make the headline of each class of a sweep without results, by `deciding_surrogate`."""
    decides = deciding_surrogate(run.surrogates)
    headlines, by = [], labels.surrogate_name(decides)
    for name in run.classes:
        table = surrogates_of(run.surrogates, group.setting, name)
        if decides not in table.columns or not table[decides].notna().any():
            continue
        ranked = table[decides].dropna().sort_values(ascending=False, kind="stable")
        best, unit = str(ranked.index[0]), labels.surrogate_unit(decides)
        lead = f"{ranked.iloc[0]:,.5g} {unit}"
        # Sums of the same terms in another order differ by rounding.
        equal = len(ranked) > 1 and np.allclose(ranked, ranked.iloc[0], rtol=1e-9, atol=0)
        if equal:
            lead += f" for all {len(ranked):,} placements"
        elif len(ranked) > 1 and ranked.iloc[1] > 0:
            ahead = 100 * (ranked.iloc[0] / ranked.iloc[1] - 1)
            lead += f", {ahead:.2g} % ahead of {ranked.index[1]}, of {len(ranked):,} placements"
        nothing = "h_pog" in table.columns and bool((table["h_pog"] == 0).all())
        why = f"H_POG is 0: no {name} was seen, or always in the same voxels." if nothing else ""
        first = "no placement is ahead" if equal else best
        title, place = f"Highest {by} for {name}", group.title * group.varies
        headlines.append(Statement(title, place, by, first, lead, why))
    return headlines
