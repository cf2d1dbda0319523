"""What a report is about: a run folder, and the findings that its sections share."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import pandas as pd

from tracking.findings.best_placement import BestPlacement
from tracking.findings.best_surrogate import Predictors, best_surrogates
from tracking.findings.ceiling import beside, ceilings
from tracking.findings.correlation import correlate, leave_one_out
from tracking.findings.failures import Failures
from tracking.findings.generalist import with_judgements
from tracking.findings.groups import Group, copies, groups, without
from tracking.findings.promotion import fully_trained
from tracking.findings.summary import by_surrogate, seed_means
from tracking.kitti_iou import judged
from tracking.report import recommendation
from tracking.report.headline import headline_ranking
from tracking.run_folders.sweep import RunFolder


@dataclass(frozen=True)
class Analysis:
    """What every section is made from; each finding is computed once, when it is asked for.

    `whole` has all distinct rigs, trained fully or not.
    """

    whole: RunFolder

    @classmethod
    def of(cls, complete: RunFolder) -> Analysis:
        """A run of which equal rigs count once."""
        return cls(without(complete, set(copies(complete))))

    @cached_property
    def run(self) -> RunFolder:
        """The placements after the longest training; shorter ones show what they cost."""
        return fully_trained(self.whole)

    @cached_property
    def surrogates(self) -> pd.DataFrame:
        """Those of the run, and what its generalist says: `with_judgements`."""
        return with_judgements(self.run)

    @cached_property
    def means(self) -> pd.DataFrame:
        run = self.run
        return seed_means(run.results, run.axes, run.left_out, run.sweep.evaluator)

    @cached_property
    def ceilings(self) -> pd.DataFrame:
        return ceilings(self.run.results, self.run.left_out, self.run.axes)

    @cached_property
    def correlations(self) -> pd.DataFrame:
        """`correlate`, `beside` the ceilings."""
        found = correlate(self.run.results, self.surrogates, self.run.axes)
        return beside(found, self.ceilings, self.run.axes)

    @cached_property
    def errors(self) -> pd.DataFrame:
        return leave_one_out(self.run.results, self.surrogates, self.run.axes)

    @cached_property
    def predicted(self) -> list[Predictors]:
        own = (self.run.results, self.surrogates, self.correlations, self.errors)
        return best_surrogates(*own, self.run.axes)

    @cached_property
    def groups(self) -> list[Group]:
        """What is compared with each other."""
        return list(groups(self.run))

    @cached_property
    def rankings(self) -> list[tuple[Group, dict[str, BestPlacement]]]:
        """Every group with its `headline_ranking`."""
        return [(group, headline_ranking(self.run, group)) for group in self.groups]

    @cached_property
    def recommended(self) -> list[recommendation.Recommendation]:
        """What each group with results recommends."""
        return recommendation.recommendations(self.run, self.rankings)

    @cached_property
    def answer(self) -> recommendation.Answer | None:
        """What they recommend together; None without results."""
        return recommendation.answer(self.run, self.recommended) if self.recommended else None

    @property
    def headline(self) -> list[str]:
        """What a terminal shows of the answer, line by line; [] without results."""
        if (said := self.answer) is None:
            return []
        more = [f"For more evidence, run: {said.command}"] if said.command else []
        return [f"{said.grade}: {said.best}", *said.leads, said.sure, *more]

    @cached_property
    def order(self) -> list[str]:
        """Placements by headline AP of the first class, over all groups; then by a surrogate."""
        own = judged(self.means, self.run.results, self.run.classes[0])
        mean = own.groupby("placement")["mean"].mean().sort_values(ascending=False)
        further = (*by_surrogate(self.run.surrogates), *self.run.placements)
        return list(dict.fromkeys((*mean.index.tolist(), *further)))

    @cached_property
    def pair(self) -> Failures | None:
        """`compared_failures`."""
        return recommendation.compared_failures(self.run, self.rankings)
