"""Statistics of a run folder that its pages share, each computed once."""

from dataclasses import dataclass
from functools import cached_property

import pandas as pd

from tracking.findings.best_surrogate import Predictors, best_surrogates
from tracking.findings.ceiling import ceilings, with_ceilings
from tracking.findings.correlation import correlate, leave_one_out
from tracking.findings.failures import Failures
from tracking.findings.generalist import with_judgements
from tracking.findings.groups import Group, copies, groups, without
from tracking.findings.paired import with_sums
from tracking.findings.promotion import fully_trained
from tracking.findings.summary import by_surrogate, seed_means
from tracking.kitti_iou import at_headline_iou
from tracking.report.recommendation import Answer, Recommendation, answer, compared_failures
from tracking.run_folders.sweep import RunFolder


@dataclass(frozen=True)
class Analysis:
    """Run folder with what its pages are made from; each statistic is computed when first read."""

    complete: RunFolder

    @cached_property
    def duplicates(self) -> dict[str, str]:
        """Placements whose rig is that of an earlier one, with the name of the earlier one."""
        return copies(self.complete)

    @cached_property
    def whole(self) -> RunFolder:
        """Distinct rigs of the run, trained fully or not; equal rigs count once."""
        return without(self.complete, set(self.duplicates))

    @cached_property
    def run(self) -> RunFolder:
        """Distinct rigs after the longest training; shorter ones show what they cost."""
        return fully_trained(self.whole)

    @cached_property
    def surrogates(self) -> pd.DataFrame:
        """Surrogates of the run and the values of its generalist; see `with_judgements`."""
        return with_judgements(self.run)

    @cached_property
    def summed_surrogates(self) -> pd.DataFrame:
        """Surrogates with rows of class "all" added; see `with_sums`."""
        return with_sums(self.surrogates, self.run.axes)

    @cached_property
    def means(self) -> pd.DataFrame:
        """Means over seeds with their intervals; see `seed_means`."""
        run = self.run
        return seed_means(run.results, run.axes, run.left_out, run.sweep.evaluator)

    @cached_property
    def ceilings(self) -> pd.DataFrame:
        """Correlations that a perfect surrogate is expected to reach; see `ceilings`."""
        return ceilings(self.run.results, self.run.left_out, self.run.axes)

    @cached_property
    def correlations(self) -> pd.DataFrame:
        """Correlations of surrogates with metrics, with their ceilings; see `correlate`."""
        correlations = correlate(self.run.results, self.surrogates, self.run.axes)
        return with_ceilings(correlations, self.ceilings, self.run.axes)

    @cached_property
    def errors(self) -> pd.DataFrame:
        """Errors of predicting a placement that is left out; see `leave_one_out`."""
        return leave_one_out(self.run.results, self.surrogates, self.run.axes)

    @cached_property
    def predictors(self) -> list[Predictors]:
        """Surrogates ranked by how well they predict a metric, a ranking for each group."""
        tables = (self.run.results, self.surrogates, self.correlations, self.errors)
        return best_surrogates(*tables, self.run.axes)

    @cached_property
    def groups(self) -> list[Group]:
        """Parts of the sweep within which placements are compared."""
        return list(groups(self.run))

    @cached_property
    def rankings(self) -> list[Recommendation]:
        """Ranking of each group; empty for a group without results."""
        return [Recommendation(self.run, group) for group in self.groups]

    @cached_property
    def recommended(self) -> list[Recommendation]:
        """Recommendation of each group with results."""
        return [ranked for ranked in self.rankings if ranked.ranking]

    @cached_property
    def answer(self) -> Answer | None:
        """Recommendation of all groups together; None without results."""
        return answer(self.run, self.recommended) if self.recommended else None

    @property
    def headline(self) -> list[str]:
        """Lines of the answer in a terminal, the answer last; [] without results."""
        if (answer := self.answer) is None:
            return []
        more = [f"For more evidence, run: {answer.command}"] if answer.command else []
        *leads, last = answer.leads
        why = f"{last} {answer.certainty}".rstrip()
        return [*more, *leads, why, f"{answer.grade}: {answer.best}"]

    @cached_property
    def order(self) -> list[str]:
        """Placements by headline AP of the first class, over all groups; then by a surrogate."""
        of_class = at_headline_iou(self.means, self.run.results, self.run.classes[0])
        mean = of_class.groupby("placement")["mean"].mean().sort_values(ascending=False)
        further = (*by_surrogate(self.run.surrogates), *self.run.placements)
        return list(dict.fromkeys((*mean.index.tolist(), *further)))

    @cached_property
    def pair(self) -> Failures | None:
        """Objects that the recommended rig and the next one find; see `compared_failures`."""
        return compared_failures(self.recommended)
