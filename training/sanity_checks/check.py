"""The check of detections from elsewhere, whoever reads them."""

from collections.abc import Collection, Iterator
from itertools import chain

import pandas as pd

from lidarplace.base.errors import InputError
from training.sanity_checks.conventions import doubts_of_conventions
from training.sanity_checks.doubt import DetectionCheck, DetectionDoubt
from training.sanity_checks.hits import doubts_of_hits
from training.sanity_checks.sample import Sample

MOST_EQUAL = 0.05
"""Share of rows that may equal another one: networks without a suppression repeat boxes."""


def check_detections(
    detections: pd.DataFrame,
    labels: pd.DataFrame,
    frames: pd.DataFrame,
    place: object,
    accept: Collection[DetectionCheck],
    accepting: str,
) -> list[str]:
    """Compare detections with the labels of their frames.

    Args:
        detections: `lidarplace.detections.read.COLUMNS`.
        labels: the objects that count: frame, class and `GEOMETRY`.
        frames: scene and frame of the frames, and poses where they are known.
        place: names the detections in messages.
        accept: checks whose doubts are left out.
        accepting: how a user accepts one, {} being its name.

    Returns cautions, a line each. Raises InputError for a doubt that is certain.
    """
    cautions = []
    sample = Sample.of(detections, labels, frames)
    for doubt in doubts_of_detections(sample):
        if doubt.check not in accept:
            fix = f"{doubt.remedy}, or accept the values: {accepting.format(doubt.check)}"
            error = InputError(doubt.why, place=str(place), key=f"column {doubt.column}", fix=fix)
            if doubt.certain:
                raise error
            cautions.append(str(error))
    return cautions


def doubts_of_detections(sample: Sample) -> Iterator[DetectionDoubt]:
    """Yield all doubts, first those that explain others; none without labels or detections."""
    if len(sample.labels) and len(sample.detections):
        yield from chain(
            _doubts_of_rows(sample), doubts_of_conventions(sample), doubts_of_hits(sample)
        )


def _doubts_of_rows(sample: Sample) -> Iterator[DetectionDoubt]:
    equal = sample.detections[sample.chosen_detections()].duplicated()
    if equal.sum() > max(1, MOST_EQUAL * len(equal)):
        why = f"{equal.sum():,} of {len(equal):,} rows equal another one"
        yield DetectionDoubt("rows", "frame", why, "name each file once")
