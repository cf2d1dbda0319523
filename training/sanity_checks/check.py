"""The check of detections from elsewhere, whoever reads them."""

from collections.abc import Collection, Iterator
from itertools import chain

import pandas as pd

from lidarplace.base.errors import InputError
from lidarplace.logs.plausibility import DetectionCheck, ImplausibleValue, cautions_of
from training.sanity_checks.conventions import implausible_conventions
from training.sanity_checks.hits import implausible_hits
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
        accept: checks whose implausible values are accepted.
        accepting: how a user accepts one, {} being its name.

    Returns cautions, a line each. Raises InputError for a value that is certain."""

    def error_of(value: ImplausibleValue) -> InputError:
        fix = f"{value.remedy}, or accept the values: {accepting.format(value.check)}"
        return InputError(value.problem, place=str(place), key=f"column {value.column}", fix=fix)

    values = implausible_detections(Sample.of(detections, labels, frames))
    return cautions_of((value, error_of(value)) for value in values if value.check not in accept)


def implausible_detections(sample: Sample) -> Iterator[ImplausibleValue]:
    """Run all checks, first those that explain others; none without labels or detections."""
    if len(sample.labels) and len(sample.detections):
        yield from chain(
            _repeated_rows(sample), implausible_conventions(sample), implausible_hits(sample)
        )


def _repeated_rows(sample: Sample) -> Iterator[ImplausibleValue]:
    equal = sample.detections[sample.chosen_detections()].duplicated()
    if equal.sum() > max(1, MOST_EQUAL * len(equal)):
        problem = f"{equal.sum():,} of {len(equal):,} rows equal another one"
        yield ImplausibleValue("rows", "frame", problem, "name each file once", certain=True)
