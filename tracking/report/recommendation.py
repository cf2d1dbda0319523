"""Recommended rig of a sweep: by which metric, how far ahead, and how certain that is."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from tracking.findings.best_placement import BestPlacement
from tracking.findings.evidence import Weakness, heaviest, remedy, weaknesses
from tracking.findings.failures import Failures, failures
from tracking.findings.groups import Group, worst_requirements
from tracking.labels import some
from tracking.report.headline import (
    Statement,
    class_label,
    headline_label,
    headline_ranking,
    statements,
)
from tracking.run_folders.sweep import RunFolder

MOST_RIGS = 6  # of one page: the best, which others are compared with


@dataclass(frozen=True)
class Recommendation:
    """Ranking of the placements of one group, and the one that it recommends, if it has results.

    `run` has distinct rigs, trained as long as they get."""

    run: RunFolder
    group: Group

    @cached_property
    def ranking(self) -> dict[str, BestPlacement]:
        """Comparison of the placements by class; see `headline_ranking`."""
        return headline_ranking(self.run, self.group)

    @cached_property
    def weaknesses(self) -> list[Weakness]:
        """Weaknesses of the evidence, the heaviest first."""
        return weaknesses(self.run, self.group)

    @cached_property
    def statements(self) -> dict[str, Statement]:
        """Headline of each class, in the order of `ranking`."""
        return statements(self.run, self.group, self.ranking, self.weaknesses)

    @property
    def by(self) -> str:
        """Class whose headline metric decides: the only one; of several all objects, "all"."""
        classes = [name for name in self.ranking if name != "all"]
        return classes[0] if len(classes) == 1 or "all" not in self.ranking else "all"

    @property
    def best(self) -> BestPlacement:
        """Recommended placement, and the others behind it."""
        return self.ranking[self.by]

    @property
    def drawn(self) -> list[str]:
        """Placements that a page draws, the best first."""
        return [str(name) for name in self.best.sure.index[:MOST_RIGS]]

    @property
    def metric(self) -> str:
        """Name of the deciding metric, as a sentence begins with it."""
        label = headline_label(self.run.results, self.by)
        of_class = f" of {class_label(self.by)}" if len(self.ranking) > 1 else ""
        return f"{label[0].upper()}{label[1:]}{of_class}"

    @property
    def required(self) -> str:
        """Sentence about the requirements of the best placement; "" without any."""
        worst = worst_requirements(self.run, self.group.setting)
        of_best = worst[worst["placement"] == self.best.best]
        if of_best.empty:
            return ""
        if of_best["met"].all():
            number = len(of_best)
            met = f"all {number} requirements" if number > 1 else "its requirement"
            return f"{self.best.best} meets {met}."
        is_open = of_best["undecided"] > 0
        failed = of_best.loc[~of_best["met"] & ~is_open, "requirement"].tolist()
        sentence = f"{self.best.best} fails {len(failed)} of {len(of_best)} requirements"
        sentence += f": {some(failed)}" if failed else ""
        opened = of_best.loc[is_open, "requirement"].tolist()
        sentence += f"; {len(opened)} open (finer positions decide): {some(opened)}" * any(is_open)
        return f"{sentence}."


@dataclass(frozen=True)
class Answer:
    """Recommendation of all groups together.

    Attributes:
        grade: what the evidence is sufficient for, a heading.
        best: the placement of the highest mean, by group where they disagree.
        leads: its value and lead, a sentence a group.
        certainty: how certain that is, and whether the groups agree.
        command: command that produces more evidence; "" if there is enough.
        other_classes: statements of the first group about classes that do not decide.
        enough: whether the evidence is sufficient."""

    grade: str
    best: str
    leads: tuple[str, ...]
    certainty: str
    command: str
    other_classes: tuple[Statement, ...]
    enough: bool


def answer(run: RunFolder, recommended: Sequence[Recommendation]) -> Answer:
    """Combine the recommendations of one group or more; their deciding classes decide."""
    deciding, several = (
        [ranked.statements[ranked.by] for ranked in recommended],
        len(recommended) > 1,
    )
    every = [
        ranked.statements[name]
        for ranked in recommended
        for name in dict.fromkeys((ranked.by, *ranked.ranking))
    ]
    weak = [weakness for statement in deciding for weakness in statement.weaknesses]
    agreement, common = _agreement(recommended)
    heading = "Recommended" if len(common) == 1 else "No rig is ahead of these"
    if weak:
        heading = "Not enough evidence to recommend a rig"
    elif not common:
        heading = "The settings disagree"
    leads = [
        (f"{statement.group}: {statement.best}. " if several else "")
        + f"{ranked.metric}: {statement.lead}."
        + (f" {statement.certainty}" if several and not weak else "")
        for ranked, statement in zip(recommended, deciding, strict=True)
    ]
    reasons = heaviest(weak)
    certainty = "" if several else deciding[0].certainty
    if reasons:  # the heading grades the evidence
        certainty = f"{reasons[0].upper()}{reasons[1:]}."
    first = recommended[0]
    return Answer(
        grade=heading,
        best=some(common) or ", ".join(f"{one.best} ({one.group})" for one in deciding),
        leads=tuple(leads),
        certainty=" ".join(filter(None, [agreement, certainty])),
        command=""
        if run.sweep.detections  # whose detectors no command of ours trains
        else remedy(run.sweep.command, [w for statement in every for w in statement.weaknesses]),
        other_classes=tuple(one for name, one in first.statements.items() if name != first.by),
        enough=not weak,
    )


def _agreement(recommended: Sequence[Recommendation]) -> tuple[str, list[str]]:
    """Say whether groups agree, "" for one; and list the placements that are best in all."""
    first = recommended[0].best
    common = [
        name for name in first.equal if all(name in ranked.best.equal for ranked in recommended)
    ]
    if len(recommended) == 1:
        return "", common
    if common:
        return f"{some(common)}: the highest mean in all {len(recommended)} settings.", common
    tied = [{*ranked.best.equal, *ranked.best.tied} for ranked in recommended]
    close = [name for name in first.sure.index if all(name in ranked for ranked in tied)]
    could = f"; {some(close)} may each be the best in all" if close else ""
    return f"The settings disagree on the best placement{could}.", common


def compared_failures(recommended: Sequence[Recommendation]) -> Failures | None:
    """Compare what the first group's recommended rig and the next one find.

    None without results, without a second rig, or where the run has no objects."""
    if not recommended or recommended[0].best.others.empty:
        return None
    first = recommended[0]
    return failures(first.run, first.group, (first.best.best, str(first.best.others.index[0])))
