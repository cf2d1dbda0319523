"""The section that compares simulated clouds with those that the same LiDARs recorded."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from tracking.findings.recorded_clouds import CLOUDS, KINDS, rank_agreement, side_by_side
from tracking.labels import setting_label
from tracking.numbers import digits, interval, signed, span
from tracking.pages.section import Section
from tracking.pages.tables import METRIC, Column, Table, numbers, words
from tracking.report.analysis import Analysis

_NOTE = (
    "Detectors were trained and evaluated on the clouds that the LiDARs of each placement "
    "recorded, and on simulated clouds of the same LiDARs. ρ and τ: whether both rank the "
    "placements alike. Their 95 % intervals allow for the seeds of the detectors on recorded "
    "clouds. Bias: simulated less recorded, mean over placements, with its 95 % interval."
)


def recorded_clouds_section(found: Analysis) -> Section | None:
    """None unless placements have results on recorded clouds and on simulated ones."""
    run = found.run
    pairs = side_by_side(run)
    if pairs.empty:
        return None
    axes = [axis for axis in run.axes if axis != CLOUDS]
    of_group = [words("class"), words("detector")]
    if axes:
        of_group.append(Column("setting", lambda row: setting_label(axes, row), words=True))
    of_group.append(METRIC)

    def coefficient(head: str, key: str) -> Column:
        def cell(row: Mapping[Any, Any]) -> str:
            if np.isnan(row[key]):
                return "–"
            return f"{signed(row[key])} {interval(row[f'{key}_low'], row[f'{key}_high'])}"

        return Column(head, cell)

    def bias(row: Mapping[Any, Any]) -> str:
        if np.isnan(row["bias"]):
            return "–"
        low, high = row["bias_low"], row["bias_high"]
        return f"{digits(row['bias'], '+z.1f')} ({span(low, high, '+z.1f')})"

    agreement = Table.of(
        "Rank agreement of simulated clouds with recorded ones",
        rank_agreement(run),
        [
            *of_group,
            numbers("placements", "n", ".0f"),
            coefficient("ρ", "spearman"),
            coefficient("τ", "kendall"),
            numbers("p of ρ", "spearman_p", ".2g"),
            Column("bias (points)", bias),
            words("note"),
        ],
        name="recorded-clouds",
        units=dict.fromkeys(("bias", "bias_low", "bias_high"), "points"),
    )
    each = Table.of(
        "Each placement on recorded and on simulated clouds",
        pairs,
        [*of_group, words("placement"), *(numbers(f"{kind} (%)", kind, ".1f") for kind in KINDS)],
        name="recorded-clouds-placements",
        units=dict.fromkeys(KINDS, "%"),
    )
    title = "Do simulated clouds rank placements as recorded ones do?"
    return Section(title, [_NOTE], tables=[agreement, each.first(50)])
