"""Precision over recall by KITTI's definition, in plain Python."""

import numpy as np

from training.average_precision import COUNTS, OTHER


def plain_curve(frames, minimum, points=41):
    """The definition in plain Python: per frame (overlaps [gt][dt], scores, gt roles, dt roles).

    With a point more than there are ground truths every hit is one.
    """

    def match(overlaps, scores, truth_role, found_role, lowest, by_score):
        taken, hits = set(), []
        for g, role in enumerate(truth_role):
            fits = [
                d
                for d in range(len(scores))
                if d not in taken and found_role[d] != OTHER and scores[d] >= lowest
                and overlaps[g][d] > minimum
            ]  # fmt: skip
            if role == OTHER or not fits:
                continue
            if by_score:
                best = max(fits, key=lambda d: (scores[d], -d))
            else:
                counting = [d for d in fits if found_role[d] == COUNTS]
                best = max(counting, key=lambda d: (overlaps[g][d], -d)) if counting else fits[0]
            taken.add(best)
            if role == COUNTS and found_role[best] == COUNTS:
                hits.append(scores[best])
        alarms = [
            d for d in range(len(scores))
            if d not in taken and found_role[d] == COUNTS and scores[d] >= lowest
        ]  # fmt: skip
        return hits, len(alarms)

    scores = sorted((s for f in frames for s in match(*f, -np.inf, True)[0]), reverse=True)
    total = sum(role == COUNTS for f in frames for role in f[2])
    sampled, recall = [], 0.0
    for i, score in enumerate(scores):
        last = i == len(scores) - 1
        if not last and (i + 2) / total - recall < recall - (i + 1) / total:
            continue
        sampled.append(score)
        recall += 1 / (points - 1)
    precision = {}
    for score in set(sampled):
        matched = [match(*f, score, False) for f in frames]
        hits, alarms = sum(len(h) for h, _ in matched), sum(a for _, a in matched)
        precision[score] = hits / (hits + alarms) if hits + alarms else 0.0
    curve = np.zeros(points)
    curve[: len(sampled)] = [precision[score] for score in sampled]
    return np.maximum.accumulate(curve[::-1])[::-1], len(scores) / total
