"""Scores from which on ground truths are matched: enough for the AP of any part of them.

AP where every box counts needs of the second pass of KITTI's evaluation only how many ground truths
are matched at a score, and how many detections there are. A ground truth that is matched at some
score stays matched at lower ones, whatever takes it: further detections only add to the choice of
each. So two scores of every ground truth replace the overlaps, and leaving objects or frames out
takes no new matching."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.kernel_cache import njit
from training.average_precision import (
    RECALL_POINTS,
    FramePairs,
    UnitScores,
    ap_r40,
    area_without_each,
    ascending_rows,
    hit_scores,
    monotone,
    precision_without_each,
)


@dataclass(frozen=True)
class Matches:
    """Ground truths and detections of one class at one overlap."""

    hit: NDArray[np.float64]  # score with which each ground truth counts for recall, NaN: missed
    matched: NDArray[np.float64]  # highest score from which on it is a true positive, NaN: never
    scores: NDArray[np.float64]  # of the detections

    @classmethod
    def of(
        cls,
        pairs: FramePairs,
        overlaps: NDArray[np.float64],
        scores: NDArray[np.float64],
        minimum_overlap: float,
    ) -> "Matches":
        """Match boxes that all count; arguments as of `average_precision.precision_curve`."""
        matched = _matched_from(pairs.layout, overlaps, scores, minimum_overlap)
        return cls(hit_scores(pairs, overlaps, scores, minimum_overlap), matched, scores)

    @cached_property
    def _orders(self) -> tuple[tuple[NDArray[np.float64], NDArray[np.int64]], ...]:
        """Scores of hits, matches and detections, each with its order."""
        return tuple((v, ascending_rows(v)) for v in (self.hit, self.matched, self.scores))

    @property
    def found(self) -> NDArray[np.bool_]:
        """Ground truths that are hit at any score, a mask of shape (G,)."""
        return ~np.isnan(self.hit)

    def precision(self) -> NDArray[np.float64]:
        """Compute the precision of `average_precision.precision_curve`, shape (41,)."""
        of_none = (np.full(len(self.hit), -1), np.full(len(self.scores), -1))
        every = np.array([len(self.hit)], np.float64)
        sampled = precision_without_each(*self._by_unit(*of_none, 1), every, RECALL_POINTS)
        return np.asarray(monotone(sampled)[0])

    def ap_without_each(
        self, truth_unit: NDArray[np.int64], detection_unit: NDArray[np.int64], units: int
    ) -> NDArray[np.float64]:
        """AP_R40 in percent without each unit, shape (units,); NaN where no ground truth is left.

        Exact where a unit has whole frames; else as if the detections that stay were matched as
        they were. Units of ground truths (G,) and detections (D,) are numbers, -1: of none."""
        left = len(truth_unit) - by_unit(truth_unit, units)
        scores = self._by_unit(truth_unit, detection_unit, units)
        sampled = precision_without_each(*scores, left, RECALL_POINTS)
        return np.where(left > 0, ap_r40(monotone(sampled)), np.nan)

    def area_without_each(
        self, truth_unit: NDArray[np.int64], detection_unit: NDArray[np.int64], units: int
    ) -> NDArray[np.float64]:
        """`ap_without_each` as the area under the precision at every hit, not at 41 recall points.

        It moves with every hit, where AP_R40 moves by whole points of recall."""
        left = len(truth_unit) - by_unit(truth_unit, units)
        area = area_without_each(*self._by_unit(truth_unit, detection_unit, units), left)
        return np.where(left > 0, 100 * area, np.nan)

    def _by_unit(
        self, truth_unit: NDArray[np.int64], detection_unit: NDArray[np.int64], units: int
    ) -> tuple[UnitScores, UnitScores, UnitScores]:
        """Scores of hits, matches and detections with their units."""
        hit, matched, detected = self._orders
        hits, matches = (UnitScores.of(*of_truth, truth_unit, units) for of_truth in (hit, matched))
        return hits, matches, UnitScores.of(*detected, detection_unit, units)


def by_unit(
    unit: NDArray[np.int64], units: int, weights: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Count the members of every unit, or sum their weights, shape (units,); -1 is no unit."""
    return np.bincount(unit + 1, weights, units + 1)[1:].astype(np.float64)


@njit(cache=True)
def _matched_from(layout, overlaps, scores, minimum):
    """Highest score at which each ground truth is matched by KITTI's second pass; NaN: never."""
    truths, detections, pairs = layout
    matched = np.full(truths[-1], np.nan)
    taken = np.zeros(detections[-1], np.bool_)
    for f in range(len(pairs) - 1):
        first, width = detections[f], detections[f + 1] - detections[f]
        count = 0
        near = np.empty(width, np.int64)  # detections that can be a match
        for d in range(first, first + width):
            for g in range(truths[f], truths[f + 1]):
                if overlaps[pairs[f] + (g - truths[f]) * width + d - first] > minimum:
                    near[count] = d
                    count += 1
                    break
        near = near[:count]
        lowest = np.inf
        while True:
            next_lower = -np.inf
            for d in near:
                next_lower = max(next_lower, scores[d]) if scores[d] < lowest else next_lower
            lowest = next_lower
            if lowest == -np.inf:
                break
            for d in near:
                taken[d] = scores[d] < lowest  # not there yet
            for g in range(truths[f], truths[f + 1]):
                row = pairs[f] + (g - truths[f]) * width - first
                best, best_overlap = -1, minimum
                for d in near:
                    if not taken[d] and overlaps[row + d] > best_overlap:
                        best, best_overlap = d, overlaps[row + d]
                if best >= 0:
                    taken[best] = True
                    if np.isnan(matched[g]):
                        matched[g] = lowest
    return matched
