"""Cautions of a report: why its numbers may be weak, one plain sentence each."""

from collections.abc import Iterator

from tracking.findings.evidence import largest_linear_share, ray_counting_caution
from tracking.report.analysis import Analysis
from tracking.run_folders.sweep import RunFolder
from tracking.statistics.coefficients import smallest_p

FEW_GROUND_TRUTHS = 200
FEW_FRAMES = 20
"""Frames of training or test below which a detector learns little, or AP hangs on few scenes."""
FEW_POG_FRAMES = 10  # below it one frame changes a probability by more than a tenth
MANY_PLACEMENTS = 20  # so many, or more, need no caution about their number
LEAST_P = 0.001  # if p can become smaller than this, no caution is needed


def cautions(analysis: Analysis) -> list[str]:
    """List all cautions: what failed, why no headline is certain yet, the rest."""
    run = analysis.run
    failed = _failed(run)
    counted = ray_counting_caution(largest_linear_share(run.surrogates))
    if run.results.empty:
        detectors = (run.trials["detector"] != "").any()
        reason = "no detector was evaluated" if detectors else "the sweep has no detector"
        alone = f"No results: {reason}. Surrogates alone do not show AP."
        return [*failed, alone, *_few_pog_frames(run), *counted, *run.sweep.cautions]
    evidence = [*_missing(run), *_weaknesses(analysis), *_few_placements(run)]
    evidence += [*_few_frames(run), *_few_objects(run)]
    return [*failed, *evidence, *counted, *run.sweep.cautions]


def _failed(run: RunFolder) -> list[str]:
    failed = run.trials[run.trials["status"] == "failed"]
    if failed.empty:
        return []
    first = str(failed["error"].iloc[0]).strip().splitlines()
    reason = f" The first error: {first[-1]}" if first else ""
    return [f"{len(failed)} of {len(run.trials)} trials did not finish.{reason}"]


def _missing(run: RunFolder) -> list[str]:
    """List placements without a result, though they were to be trained."""
    trained = run.trials[(run.trials["status"] != "pruned")]
    gone = sorted(set(trained["placement"]) - set(run.results["placement"]))
    return [f"No result for {', '.join(gone)}."] if gone else []


def _weaknesses(analysis: Analysis) -> list[str]:
    """Name each weakness once, of the group where it weighs most; the group if others differ."""
    by_kind: dict[tuple[str, ...], dict[str, tuple[float, str]]] = {}
    for ranked in analysis.rankings:
        for weakness in ranked.weaknesses:
            if weakness.classes != ("all",):  # those of its classes are named
                same = by_kind.setdefault((weakness.kind, *weakness.classes), {})
                weight = (weakness.shortfall, ranked.group.title)
                same.setdefault(weakness.sentence, weight)
    sentences = []
    for same in by_kind.values():
        text, (shortfall, title) = max(same.items(), key=lambda item: item[1])
        sentences.append((shortfall, f"{title}: {text}" if len(same) > 1 else text))
    return list(dict.fromkeys(text for _, text in sorted(sentences, key=lambda own: -own[0])))


def _few_placements(run: RunFolder) -> list[str]:
    """Count placements in the smallest group, as they are compared within groups."""
    counts = run.results.groupby(["detector", *run.axes], dropna=False)["placement"].nunique()
    n, consequence = int(counts.min()), "weak correlations go unseen."
    if n >= MANY_PLACEMENTS:
        return []
    if smallest_p(n) > LEAST_P:
        consequence = f"no two-sided p-value can be below {smallest_p(n):.2g}."
    caution = f"Only {n} placements: {consequence}"
    if n < 3:
        caution = f"{n} placements: a correlation needs at least 3."
    if n == 1:
        caution = "One placement: there is nothing to compare it with."
    return [f"In the smallest group: {caution}" if counts.nunique() > 1 else caution]


def _few_frames(run: RunFolder) -> Iterator[str]:
    train, test = run.sweep.frames.train, run.sweep.frames.test
    if train < FEW_FRAMES and not run.sweep.detections:
        yield (
            f"Only {train} training frame{'s' * (train != 1)}: a detector learns little from so "
            "few, and the surrogates use the same frames."
        )
    if test < FEW_FRAMES:
        yield (
            f"Only {test} test frame{'s' * (test != 1)}: other frames may give another AP and "
            "another order."
        )


def _few_pog_frames(run: RunFolder) -> list[str]:
    """Warn of few POG frames, where surrogates are all that the sweep has."""
    frames = run.sweep.frames.train
    if run.surrogates.empty or frames >= FEW_POG_FRAMES:
        return []
    return [
        f"The surrogates use only {frames} frame{'s' * (frames != 1)}: other frames may rank "
        "the placements differently."
    ]


def _few_objects(run: RunFolder) -> Iterator[str]:
    results = run.results[run.results["class"].isin(run.classes)]
    for name, count in results.groupby("class")["ground_truths"].min().items():
        if count == 0:
            yield f"{name}: no ground truth in the test frames, so no AP."
        elif count < FEW_GROUND_TRUTHS:
            yield f"{name}: only {count} ground truths in the test frames."
