"""Classes and scores of detections that hit a label, and of those that do not."""

import math
from collections.abc import Iterator

import numpy as np
import pandas as pd
from scipy.optimize import linear_sum_assignment
from scipy.stats import rankdata

from lidarplace.base.number_text import percent
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.logs.plausibility import ImplausibleValue
from training.sanity_checks.sample import Overlaps, Sample

HIT = 0.3
"""IoU from above of a detection that hits a label."""
LEAST = 10
"""Hits of other classes."""
MANY = 4
"""So many times more hits have the other class."""
LEAST_AUC, SIGMAS = 0.35, 4
"""Least probability that a hit has a higher score than a false alarm, and how many standard
deviations below 1/2 are no chance."""


def implausible_hits(sample: Sample) -> Iterator[ImplausibleValue]:
    """Check classes and scores."""
    boxes = sample.detections[list(GEOMETRY)].to_numpy(np.float64)
    overlaps = sample.overlaps(boxes, sample.frame, three_d=False)
    hit = overlaps.iou > HIT
    hits = Overlaps(overlaps.label[hit], overlaps.detection[hit], overlaps.iou[hit])
    yield from _classes(sample, hits)
    yield from _scores(sample, hits)


def _classes(sample: Sample, hits: Overlaps) -> Iterator[ImplausibleValue]:
    """Check for classes that hit each other's objects."""
    tables = (sample.labels, hits.label), (sample.detections, hits.detection)
    truth, named = (table["class"].to_numpy()[rows] for table, rows in tables)
    names = sorted({*truth, *named})
    counts = pd.crosstab(truth, named).reindex(index=names, columns=names, fill_value=0).to_numpy()
    of_label, of_detection = linear_sum_assignment(-counts / np.maximum(counts.sum(axis=0), 1))
    right, other = np.diag(counts)[of_detection], counts[of_label, of_detection]
    moved = (of_label != of_detection) & (other > MANY * right)
    if moved.sum() > 1 and other[moved].sum() >= LEAST:
        pairs = zip(of_detection[moved].tolist(), of_label[moved].tolist(), strict=True)
        text = ", ".join(f"{names[one]} those of {names[of]}" for one, of in pairs)
        problem = f"detections hit objects of other classes: {text}; {other[moved].sum():,} times, "
        problem += f"their own {right[moved].sum():,} times"
        yield ImplausibleValue(
            "class", "class", problem, "correct the order of the classes", certain=True
        )


def _scores(sample: Sample, hits: Overlaps) -> Iterator[ImplausibleValue]:
    """Check for scores out of range, or lower for hits than for false alarms between the labels.

    Hits and false alarms are compared class by class (Mann and Whitney)."""
    detections, labels = sample.detections, sample.labels
    score, name = detections["score"].to_numpy(np.float64), detections["class"].to_numpy()
    same = labels["class"].to_numpy()[hits.label] == name[hits.detection]
    hit = np.zeros(len(detections), bool)
    hit[hits.detection[same]] = True
    near = sample.chosen_detections()
    for axis in "xy":
        near &= detections[axis].between(labels[axis].min(), labels[axis].max()).to_numpy()
    pairs = pairs_won = variance = 0.0
    for of_class in pd.unique(name):
        rows = np.flatnonzero(near & (name == of_class))
        hit_count = int(hit[rows].sum())
        both = hit_count * (len(rows) - hit_count)
        pairs += both
        pairs_won += rankdata(score[rows])[hit[rows]].sum() - hit_count * (hit_count + 1) / 2
        variance += both * (len(rows) + 1) / 12
    low, high = score.min(), score.max()
    if pairs_won < min(LEAST_AUC * pairs, pairs / 2 - SIGMAS * math.sqrt(variance)):
        won = f"{percent(pairs_won / pairs)}"
        problem = f"a hit has a higher score than a false alarm in {won} of the pairs"
        remedy = "the surer the higher; negate them" if high <= 0 else "the surer the higher"
        yield ImplausibleValue("score", "score", problem, remedy, certain=bool(high <= 0))
    elif low < 0 or high > 1:
        unit = "percent" if low >= 0 and high <= 100 else "logits"
        problem = f"scores are from {low:.3g} to {high:.3g}, as {unit} are; "
        problem += "AP uses their order only"
        yield ImplausibleValue("score", "score", problem, "convert them to 0 to 1", certain=False)
