"""Relative errors, rank agreement and paired differences in numbers."""

import numpy as np
import pandas as pd
import pytest

from tracking.findings.surrogate_accuracy import rank_agreement, relative_errors, summarise
from tracking.report.sections.sampling_error import (
    paired_differences,
    separated,
    separation_sentences,
)
from tracking.run_folders.sweep import RunFolder


def test_errors_and_ranks():
    rows = []
    for name, fine in (("a", -1.0), ("b", -2.0), ("c", -4.0)):
        for method, resolution, steps, value in (
            ("cone", 0.1, 0, fine),
            ("cone", 0.2, 0, 2 * fine),
            ("dda", 0.2, 90, 1.5 * fine),
            ("dda", 0.2, 9, 1 / fine - 9),
        ):
            rows.append((name, "Car", "s_mig", method, resolution, steps, 10, value, 0.1, 1.0))
    columns = ["placement", "class", "surrogate", "method", "resolution", "azimuth_steps"]
    table = pd.DataFrame(rows, columns=[*columns, "frames", "comparable", "seconds", "pog_seconds"])
    table["reference"] = table["resolution"] == 0.1
    found = summarise(relative_errors(table)).set_index(["resolution", "azimuth_steps"])
    assert found["median_error"].iloc[:3].tolist() == pytest.approx([0, 1, 0.5])
    assert found["median_method_error"].iloc[:3].tolist() == pytest.approx([0, 0, 0.25])
    assert found["spearman"].tolist() == pytest.approx([1, 1, 1, -1])
    assert found["kendall"].tolist() == pytest.approx([1, 1, 1, -1])
    assert found["reference"].tolist() == [True, False, False, False]


def test_no_rank_of_two_or_of_equal_values():
    assert np.isnan(rank_agreement([1, 2], [1, 2])).all()
    assert np.isnan(rank_agreement([1, 1, 1], [1, 2, 3])).all()


def test_pairs_are_told_apart_though_their_intervals_overlap(made_up_run):
    run = RunFolder.read(made_up_run)
    pairs = paired_differences(run.sampling_error, run.pog_resamples)
    assert len(pairs) == 10
    assert separated(pairs).all()
    assert "does not blur" in separation_sentences(pairs, "Car")[0]
    blurred = pairs.assign(low=-1.0, high=1.0)
    assert "S-MIG 0 of 10" in separation_sentences(blurred, "Car")[0]
