"""Sampling error of the POG."""

from collections.abc import Mapping
from functools import partial
from itertools import combinations
from typing import Any

import pandas as pd

from lidarplace.pog.surrogates.sampling_error import NORMAL_95
from lidarplace.pog.surrogates.table import HEADLINE_SURROGATES
from tracking.findings.groups import by_setting, studied
from tracking.labels import in_order, known, surrogate_label, surrogate_name, surrogate_unit
from tracking.pages.section import Column, Section, Table, slug, words
from tracking.report.analysis import Analysis

_NUMBERS = {"value": "value", "sd": "sd", "bias": "bias", "95 % low": "low", "95 % high": "high"}
MOST_INTERVALS = 20  # placements whose sampling errors are shown: every pair of them is compared


def sampling_error_section(analysis: Analysis) -> Section:
    """Show how much the surrogates would change with other frames."""
    run = analysis.run
    section = Section("Surrogates: sampling error of the POG")
    if run.sampling_error is None or run.pog_resamples is None or run.pog_resamples.empty:
        section.notes.append(
            "Sampling errors: not computed; surrogate.sampling_error of a sweep adds them."
        )
        return section
    section.notes.append(
        "The POG is counted over some frames and not over all traffic. Blocks of consecutive "
        "frames of a route were drawn again with replacement, the same for every placement. "
        "Intervals are 1.96 standard deviations to each side, nominally 95 % and somewhat less "
        "with few blocks. Entropies from few frames are too low; the estimated bias is taken off "
        "the interval, not off the value."
    )
    section.notes += studied(run, run.sampling_error)
    known_names = set(run.sampling_error["placement"])
    best_names = [name for name in analysis.order if name in known_names][:MOST_INTERVALS]
    if len(best_names) < len(known_names):
        section.notes.append(
            f"The best {len(best_names)} of {len(known_names):,} placements; "
            "sampling_error.parquet has all."
        )
    best, draws = (
        table[table["placement"].isin(best_names)]
        for table in (run.sampling_error, run.pog_resamples)
    )
    resamples = dict(by_setting(draws, run.axes))
    for title, part in by_setting(best, run.axes):
        of_headline = part[part["surrogate"].isin(HEADLINE_SURROGATES)]
        pairs = paired_differences(of_headline, resamples[title])
        for name, of_class in part.groupby("class", sort=False):
            label = f"{name} · {title}" if title else str(name)
            section.notes += separation_sentences(pairs[pairs["class"] == name], label)
            section.tables.append(_sampling_error_table(of_class, label))
    return section


def _sampling_error_table(estimates: pd.DataFrame, title: str) -> Table:
    columns = [
        words("surrogate", show=surrogate_label),
        words("placement"),
        *(Column(head, partial(_known, key)) for head, key in _NUMBERS.items()),
    ]
    order = in_order(estimates["surrogate"])
    rows = estimates.sort_values("surrogate", key=lambda of: of.map(order.index), kind="stable")
    caption = f"Sampling error · {title}"
    if "blocks" in estimates:
        drawn, blocks = (estimates[key].iloc[0] for key in ("resamples", "blocks"))
        caption += f" · {drawn} draws of {blocks} blocks"
    data = estimates.assign(unit=[surrogate_unit(name) for name in estimates["surrogate"]])
    name = slug("sampling error", title)
    return Table.of(caption, rows, columns, wide=True, name=name, data=data)


def _known(key: str, row: Mapping[Any, Any]) -> str:
    return known(row[key], row["sd"])


def paired_differences(estimates: pd.DataFrame, resamples: pd.DataFrame) -> pd.DataFrame:
    """Compare two placements over the same draws of frames, whose common part cancels.

    Each pair once: class, surrogate, placement, other, the difference of their values, and low and
    high of its 95 % interval, bias taken off as in `lidarplace.pog.surrogates.sampling_error`."""
    rows = []
    for (name, surrogate), estimates_of_class in estimates.groupby(
        ["class", "surrogate"], sort=False
    ):
        drawn = resamples[(resamples["class"] == name) & (resamples["surrogate"] == surrogate)]
        by_placement = drawn.pivot(index="resample", columns="placement", values="value")
        value = estimates_of_class.set_index("placement")["value"]
        for placement, other in combinations(value.index, 2):
            difference = value[placement] - value[other]
            spread = by_placement[placement] - by_placement[other]
            # As the interval of a value: about the value less its bias, as wide as the resamples.
            centre, half = 2 * difference - spread.mean(), NORMAL_95 * spread.std()
            low, high = centre - half, centre + half
            rows.append((name, surrogate, placement, other, difference, low, high))
    columns = ["class", "surrogate", "placement", "other", "difference", "low", "high"]
    return pd.DataFrame(rows, columns=columns)


def separation_sentences(pairs: pd.DataFrame, title: str) -> list[str]:
    """Say whether the POG's sampling error blurs the ranking; [] for one placement.

    `pairs` are `paired_differences` of the class and setting of `title`."""
    headlines = pairs[pairs["surrogate"].isin(HEADLINE_SURROGATES)]
    if headlines.empty:
        return []
    apart = (headlines["low"] > 0) | (headlines["high"] < 0)
    counts_kept = apart.groupby(headlines["surrogate"], sort=False).agg(["sum", "size"])
    counts = [
        f"{surrogate_name(str(name))} {row['sum']} of {row['size']}"
        for name, row in counts_kept.iterrows()
    ]
    verdict = "does not blur" if apart.all() else "blurs"
    return [
        f"{title}: the POG's sampling error {verdict} the ranking of the placements. Pairs whose "
        f"order other frames would keep (paired difference, 95 %): {', '.join(counts)}."
    ]
