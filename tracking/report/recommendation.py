"""Which rig is recommended, by what, and what is said of it."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from tracking.findings.best_placement import BestPlacement
from tracking.findings.evidence import grade, remedy
from tracking.findings.failures import Failures, failures
from tracking.findings.groups import Group
from tracking.findings.groups import verdicts as verdicts_of
from tracking.labels import some
from tracking.report.headline import Verdict, class_label, headline_label, verdicts
from tracking.run_folders.sweep import RunFolder

MOST_RIGS = 6  # of one page: the best, which others are compared with


@dataclass(frozen=True)
class Recommendation:
    """What a group recommends, by its `headline_ranking`, `ranked`.

    `by` is the class whose headline metric decides: the only one by its AP, several by the recall
    of all objects together, "all".
    """

    run: RunFolder
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

    def metric(self, run: RunFolder) -> str:
        """What decides, at the beginning of a sentence."""
        label = headline_label(run.results, self.by)
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

    @cached_property
    def verdicts(self) -> dict[str, Verdict]:
        """By class, in the order of `ranked`."""
        return dict(zip(self.ranked, verdicts(self.run, self.group, self.ranked), strict=True))


def recommendations(
    run: RunFolder, rankings: Iterable[tuple[Group, Mapping[str, BestPlacement]]]
) -> list[Recommendation]:
    """Those of all groups with results, in their order."""
    found = []
    for group, ranked in rankings:
        if ranked:
            classes = [name for name in ranked if name != "all"]
            by = classes[0] if len(classes) == 1 or "all" not in ranked else "all"
            found.append(Recommendation(run, group, by, ranked))
    return found


@dataclass(frozen=True)
class Answer:
    """What all groups recommend together.

    Attributes:
        grade: what the evidence is enough for, a heading.
        best: the placement of the highest mean, by group where they disagree.
        leads: its value and lead, a sentence a group.
        sure: how sure that is, and whether the groups agree.
        command: what to run for more evidence; "" if there is enough.
        beside: of the first group, what is said of the classes that do not decide.
    """

    grade: str
    best: str
    leads: tuple[str, ...]
    sure: str
    command: str
    beside: tuple[Verdict, ...]
    enough: bool


def answer(run: RunFolder, found: Sequence[Recommendation]) -> Answer:
    """What the groups say together, at least one; their deciding classes decide."""
    first, several = [own.verdicts[own.by] for own in found], len(found) > 1
    every = [own.verdicts[name] for own in found for name in dict.fromkeys((own.by, *own.ranked))]
    weak = [weakness for own in first for weakness in own.weaknesses]
    agree, same = _agreement(found)
    grade_ = "Recommended" if len(same) == 1 else "No rig is ahead of these"
    if weak:
        grade_ = "Not enough evidence to recommend a rig"
    elif not same:
        grade_ = "The settings disagree"
    leads = [
        (f"{said.group}: {said.best}. " if several else "")
        + f"{own.metric(run)}: {said.lead}."
        + (f" {said.sure}" if several and not weak else "")
        for own, said in zip(found, first, strict=True)
    ]
    return Answer(
        grade_,
        some(same) or ", ".join(f"{said.best} ({said.group})" for said in first),
        tuple(leads),
        " ".join(filter(None, [agree, grade(weak) or ("" if several else first[0].sure)])),
        ""
        if run.sweep.detections  # whose detectors no command of ours trains
        else remedy(run.sweep.command, [w for said in every for w in said.weaknesses]),
        tuple(said for name, said in found[0].verdicts.items() if name != found[0].by),
        not weak,
    )


def _agreement(found: Sequence[Recommendation]) -> tuple[str, list[str]]:
    """Whether groups agree, a sentence, "" for one; and the placements that are best in all."""
    same = [n for n in found[0].best.equal if all(n in own.best.equal for own in found)]
    if len(found) == 1:
        return "", same
    if same:
        return f"{some(same)}: the highest mean in all {len(found)} settings.", same
    tied = [{*own.best.equal, *own.best.tied} for own in found]
    close = [n for n in found[0].best.sure.index if all(n in own for own in tied)]
    could = f"; {some(close)} may each be the best in all" if close else ""
    return f"The settings disagree on the best placement{could}.", same


def compared_failures(
    run: RunFolder, rankings: Iterable[tuple[Group, Mapping[str, BestPlacement]]]
) -> Failures | None:
    """What the recommended rig and the next one behind it found, where both is known.

    `run` has distinct rigs, trained as long as they get; `rankings` are groups with their
    `headline_ranking`.
    """
    first = next(iter(recommendations(run, rankings)), None)
    if first is None or first.best.others.empty:
        return None
    return failures(run, first.group, (first.best.best, str(first.best.others.index[0])))
