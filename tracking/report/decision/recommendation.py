"""Which rig is recommended, by what, and what is said of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lidarplace.metrics import headline_metric
from tracking.findings.best_placement import BestPlacement
from tracking.findings.groups import GENERALIST, Group
from tracking.findings.individuals import count_individuals
from tracking.findings.requirements import verdicts as verdicts_of
from tracking.kitti_iou import headline_iou
from tracking.labels import metric_label, some
from tracking.report.headline import Verdict, class_label, verdicts
from tracking.run_folders.sweep import RunFolder

MOST_RIGS = 6
"""Of one page: the best, which others are compared with."""


@dataclass(frozen=True)
class Recommendation:
    """What a group recommends.

    Attributes:
        by: the class whose headline metric decides: the only one by its AP, several by the recall
            of all objects together, "all".
        ranked: `headline_ranking` of the group, by class.
    """

    group: Group
    by: str
    ranked: Mapping[str, BestPlacement]

    @property
    def best(self) -> BestPlacement:
        """The recommended placement and the others behind it."""
        return self.ranked[self.by]

    @property
    def shown(self) -> list[str]:
        """Placements that the page draws, the best first."""
        return [str(name) for name in self.best.sure.index[:MOST_RIGS]]

    @property
    def compared(self) -> tuple[str, str] | None:
        """The recommended placement and the next one behind it; None: there is no other."""
        others = self.best.others.index
        return (self.best.best, str(others[0])) if len(others) else None

    def metric(self, run: RunFolder) -> str:
        """What decides, at the beginning of a sentence."""
        label = metric_label(headline_metric(self.by), headline_iou(run.results, self.by))
        of = f" of {class_label(self.by)}" if len(self.ranked) > 1 else ""
        return f"{label[0].upper()}{label[1:]}{of}"

    def required(self, run: RunFolder) -> str:
        """Which requirements the best placement fails, a sentence; "" if there are none."""
        found = verdicts_of(run, self.group.setting)
        own = found[found["placement"] == self.best.best]
        if own.empty:
            return ""
        failed = own.loc[~own["met"], "requirement"].tolist()
        if not failed:
            return f"{self.best.best} meets all {len(own)} requirements."
        return f"{self.best.best} fails {len(failed)} of {len(own)} requirements: {some(failed)}."

    def verdicts(self, run: RunFolder) -> list[Verdict]:
        """That of the deciding class first, then those of the others."""
        said = dict(zip(self.ranked, verdicts(run, self.group, self.ranked, []), strict=True))
        return [said.pop(self.by), *said.values()]


def recommendations(
    rankings: Sequence[tuple[Group, Mapping[str, BestPlacement]]],
) -> list[Recommendation]:
    """Those of all groups with results, in their order."""
    return [
        Recommendation(group, _deciding(ranked), ranked) for group, ranked in rankings if ranked
    ]


def _deciding(ranked: Mapping[str, BestPlacement]) -> str:
    classes = [name for name in ranked if name != "all"]
    return classes[0] if len(classes) == 1 or "all" not in ranked else "all"


def not_known(run: RunFolder, found: Recommendation) -> str:
    """What the odds allow for and what they do not: seeds, frames, towns; one sentence."""
    best = found.best
    frames = f"the {run.sweep.frames.test:,} test frames{_routes(run)}"
    # Not those of the noise, which stand for test objects, too.
    seeds = int(best.others["seeds"].max()) if len(best.others) else 1
    judge = "generalist" if found.group.judge == GENERALIST else "seed"
    trained = f"{seeds} {judge}{'s' * (seeds != 1)}"
    odds = len(best.sure) > 1 and bool(np.isfinite(best.sure.iloc[0]))
    held: list[str] = []
    open_: list[str] = []
    for known, chance, other in (
        (seeds > 1, f"the chance of training ({trained})", f"other {judge}s"),
        (best.sample is not None, f"which road users {frames} met", f"other frames than {frames}"),
    ):
        (held if odds and known else open_).append(chance if odds and known else other)
    beyond = ", ".join([*open_, "other towns, other traffic or a longer training would say"])
    if not held:
        return f"Not known is what {beyond}."
    return f"The odds allow for {' and '.join(held)}; not known is what {beyond}."


def _routes(run: RunFolder) -> str:
    """On how many routes, where that is known and the same for all settings."""
    if run.individuals is None or set(run.axes) & set(run.individuals.columns):
        return ""
    counts = count_individuals(run.individuals[run.individuals["split"] == "test"])
    return f" of {counts['routes'].max():,} routes" if len(counts) else ""
