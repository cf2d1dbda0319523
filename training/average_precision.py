"""Average precision from overlaps, by the rules of the official KITTI evaluation.

The algorithm is that of the KITTI development kit as OpenPCDet runs it (`eval.py`: get_thresholds,
compute_statistics): a first pass collects the scores at which recall grows and samples 41 of them,
a second one counts hits and false alarms at each."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import inner, njit

COUNTS, IGNORED, OTHER = 0, 1, -1
"""Roles of a box for the class under test: it counts, is neither hit nor miss, is not used."""

RECALL_POINTS = 41


class FramePairs(NamedTuple):
    """Every pair of a ground truth and a detection of one frame; compiled code takes `layout`."""

    truths: NDArray[np.int64]  # ground truths of frame f are rows `truths[f]:truths[f + 1]`
    detections: NDArray[np.int64]  # the same for detections
    # The pairs of frame f start here; (ground truth g, detection d), both counted from the frame's
    # first, is pair `starts[f] + g * (detections of f) + d`
    starts: NDArray[np.int64]
    ground_truth: NDArray[np.int64]  # row in each pair, shape (P,)
    detection: NDArray[np.int64]  # the same

    @property
    def layout(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """`truths`, `detections` and `starts`."""
        return self[:3]

    @classmethod
    def of(
        cls, ground_truth_frame: NDArray[np.int64], detection_frame: NDArray[np.int64], frames: int
    ) -> "FramePairs":
        """Pair the rows of each frame; both arrays hold sorted frame indices below `frames`."""
        edges = np.arange(frames + 1)
        truths = np.searchsorted(ground_truth_frame, edges)
        detections = np.searchsorted(detection_frame, edges)
        per_truth = np.diff(detections)[ground_truth_frame]
        ground_truth = np.repeat(np.arange(len(ground_truth_frame)), per_truth)
        within = np.arange(len(ground_truth)) - (np.cumsum(per_truth) - per_truth)[ground_truth]
        detection = detections[ground_truth_frame[ground_truth]] + within
        starts = np.concatenate([[0], np.cumsum(np.diff(truths) * np.diff(detections))])
        return cls(truths, detections, starts, ground_truth, detection)


class Roles(NamedTuple):
    """Roles of all boxes for the class under test."""

    truths: NDArray[np.int8]  # COUNTS, IGNORED or OTHER, shape (G,)
    detections: NDArray[np.int8]  # the same, shape (D,)
    harmless: NDArray[np.bool_]  # detections that are no false alarm even if unmatched, shape (D,)


class PrecisionCurve(NamedTuple):
    """Precision over recall, as KITTI samples it; 0 if no ground truth counts."""

    # At the recall points 0, 1/40, …, 1, none below one to its right; 0 beyond those reached, (41,)
    precision: NDArray[np.float64]
    similarity: NDArray[np.float64]  # the same with each hit counted as the similarity of its pair
    recall: float  # the share of the ground truths that is hit at any score


@njit(cache=True)
def _recall_pass(layout, overlaps, scores, truth_role, detection_role, minimum):
    """Score of each ground truth's hit when it takes the detection of highest score; NaN: none."""
    truths, detections, pairs = layout
    hits = np.full(len(truth_role), np.nan)
    taken = np.zeros(len(detection_role), np.bool_)
    for f in range(len(pairs) - 1):
        width = detections[f + 1] - detections[f]
        for g in range(truths[f], truths[f + 1]):
            if truth_role[g] == -1:
                continue
            row = pairs[f] + (g - truths[f]) * width - detections[f]
            best, best_score = -1, -np.inf
            for d in range(detections[f], detections[f + 1]):
                if detection_role[d] == -1 or taken[d]:
                    continue
                if overlaps[row + d] > minimum and scores[d] > best_score:
                    best, best_score = d, scores[d]
            if best < 0:
                continue
            taken[best] = True
            if truth_role[g] == 0 and detection_role[best] == 0:
                hits[g] = scores[best]
    return hits


@njit(cache=True)
def _precision_pass(layout, overlaps, similarity, scores, roles, minimum, lowest):
    """True and false positives, and the similarity of the true ones, at each score of `lowest`."""
    truths, detections, pairs = layout
    truth_role, detection_role, harmless = roles
    counts = np.zeros((len(lowest), 3))
    taken = np.zeros(len(detection_role), np.bool_)
    for t in range(len(lowest)):
        taken[:] = False
        for f in range(len(pairs) - 1):
            width = detections[f + 1] - detections[f]
            for g in range(truths[f], truths[f + 1]):
                if truth_role[g] == -1:
                    continue
                row = pairs[f] + (g - truths[f]) * width - detections[f]
                # An ignored detection is taken only where no other fits, and then counts nothing.
                best, best_overlap = -1, minimum
                for d in range(detections[f], detections[f + 1]):
                    if detection_role[d] != 0 or taken[d] or scores[d] < lowest[t]:
                        continue
                    if overlaps[row + d] > best_overlap:
                        best, best_overlap = d, overlaps[row + d]
                if best < 0:
                    continue
                taken[best] = True
                if truth_role[g] == 0:
                    counts[t, 0] += 1
                    counts[t, 2] += similarity[row + best]
            for d in range(detections[f], detections[f + 1]):
                if not (taken[d] or detection_role[d] != 0 or harmless[d] or scores[d] < lowest[t]):
                    counts[t, 1] += 1
    return counts


@njit(cache=True)
def sampled_scores(hits, truths, points):
    """Choose the scores among falling `hits` where recall is nearest to each of the points."""
    chosen = np.empty(len(hits))
    count = 0
    recall = 0.0
    for i in range(len(hits)):
        last = i == len(hits) - 1
        left = (i + 1) / truths
        right = left if last else (i + 2) / truths
        if not last and right - recall < recall - left:
            continue
        chosen[count] = hits[i]
        count += 1
        recall += 1 / (points - 1.0)
    return chosen[:count]


def ascending_rows(values: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the rows of the values that are numbers, the lowest first."""
    return np.argsort(values)[: np.count_nonzero(~np.isnan(values))]  # NaN comes last


class UnitScores(NamedTuple):
    """Scores, each of some unit, as compiled code takes them."""

    values: NDArray[np.float64]  # all, ascending
    unit: NDArray[np.int64]  # of each
    by_unit: NDArray[np.float64]  # the same scores unit by unit, ascending within each
    offsets: NDArray[np.int64]  # those of unit u are `by_unit[offsets[u]:offsets[u + 1]]`

    @classmethod
    def of(
        cls,
        scores: NDArray[np.float64],
        order: NDArray[np.int64],
        unit: NDArray[np.int64],
        units: int,
    ) -> "UnitScores":
        """Sort scores by their `ascending_rows`, and by unit; -1 is no unit."""
        values, unit = scores[order], unit[order]
        members = np.bincount(unit + 1, minlength=units + 1)
        by_unit = np.argsort(unit, kind="stable")[members[0] :]
        return cls(values, unit, values[by_unit], np.cumsum(members) - members[0])


@inner
def _precision_of_others(matched, detected, unit, lowest):
    """Precision from each score of `lowest` on, without the unit itself."""
    positives, alarms = _count_others(matched, unit, lowest), _count_others(detected, unit, lowest)
    return positives / np.maximum(alarms, 1)


@inner
def _count_others(scores, unit, lowest):
    """Number of scores of other units that are at least each of `lowest`."""
    of_unit = scores.by_unit[scores.offsets[unit] : scores.offsets[unit + 1]]
    at_least = len(scores.values) - np.searchsorted(scores.values, lowest)
    return at_least - (len(of_unit) - np.searchsorted(of_unit, lowest))


@njit(cache=True)
def precision_without_each(hits, matched, detected, truths, points):
    """Precision without each unit at the sampled scores of the others, 0 beyond; (units, points).

    Takes `UnitScores`, see `training.matches.Matches`, and the number of ground truths of the
    others, (units,)."""
    precision = np.zeros((len(truths), points))
    falling, unit_of = hits.values[::-1].copy(), hits.unit[::-1].copy()
    for unit in range(len(truths)):
        lowest = sampled_scores(falling[unit_of != unit], truths[unit], points)
        for n, value in enumerate(_precision_of_others(matched, detected, unit, lowest)):
            precision[unit, n] = value
    return precision


@njit(cache=True)
def area_without_each(hits, matched, detected, truths):
    """Area under the precision over recall without each unit, shape (units,).

    Precision, made monotone from the right, counts at every hit, each a recall of one ground truth.
    Arguments as of `precision_without_each`; 0 where none is left."""
    area = np.zeros(len(truths))
    for unit in range(len(truths)):
        lowest = hits.values[hits.unit != unit]
        highest = 0.0
        for precision in _precision_of_others(matched, detected, unit, lowest):
            highest = max(highest, precision)
            area[unit] += highest / truths[unit]
    return area


def precision_curve(
    pairs: FramePairs,
    overlaps: NDArray[np.float64],
    scores: NDArray[np.float64],
    minimum_overlap: float,
    roles: Roles,
    similarity: NDArray[np.float64],
) -> PrecisionCurve:
    """Compute precision over recall of one class.

    `overlaps` (P,) and `similarity` (P,) are of every pair, `scores` (D,), finite, of the
    detections; a hit needs more than `minimum_overlap`."""
    least, (truth_role, detection_role, _) = minimum_overlap, roles
    hits = _recall_pass(pairs.layout, overlaps, scores, truth_role, detection_role, least)
    hits = hits[~np.isnan(hits)]
    if len(hits) == 0:
        return PrecisionCurve(np.zeros(RECALL_POINTS), np.zeros(RECALL_POINTS), 0.0)
    counted = float(np.count_nonzero(truth_role == COUNTS))
    lowest = sampled_scores(np.sort(hits)[::-1].copy(), counted, RECALL_POINTS)
    counts = _precision_pass(pairs.layout, overlaps, similarity, scores, roles, least, lowest)
    # Taking the largest overlap can lose every hit of the first pass to ignored ground truths.
    hit, alike = (counts[:, k] / np.maximum(counts[:, 0] + counts[:, 1], 1) for k in (0, 2))
    return PrecisionCurve(monotone(hit), monotone(alike), len(hits) / counted)


def hit_scores(
    pairs: FramePairs,
    overlaps: NDArray[np.float64],
    scores: NDArray[np.float64],
    minimum_overlap: float,
) -> NDArray[np.float64]:
    """Score with which each ground truth counts for recall where all boxes count, NaN: missed.

    Shape (G,). Arguments as of `precision_curve`."""
    truths, detections = (np.full(ends[-1], COUNTS, np.int8) for ends in pairs.layout[:2])
    hits = _recall_pass(pairs.layout, overlaps, scores, truths, detections, minimum_overlap)
    return np.asarray(hits)


def monotone(sampled: NDArray[np.float64]) -> NDArray[np.float64]:
    """Raise each value to the largest one to its right, and fill up with 0: (…, n) to (…, 41)."""
    curve = np.zeros((*sampled.shape[:-1], RECALL_POINTS))
    curve[..., : sampled.shape[-1]] = np.maximum.accumulate(sampled[..., ::-1], axis=-1)[..., ::-1]
    return curve


def ap_r40(curve: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean precision at the 40 recall points above 0, percent; from (…, 41) to (…)."""
    return np.asarray(100 * curve[..., 1:].mean(axis=-1))


def ap_r11(curve: NDArray[np.float64]) -> float:
    """Mean precision at the 11 recall points 0, 0.1, …, 1, percent."""
    return float(100 * curve[::4].mean())
