"""The section of the sampling error of the POG."""

from __future__ import annotations

import pandas as pd

from lidarplace.pog.surrogates.table import HEADLINE_SURROGATES
from tracking.figures.of_sweeps.intervals import intervals
from tracking.findings.groups import by_setting, studied
from tracking.findings.sampling_error import paired_differences
from tracking.labels import in_order, surrogate_label, surrogate_unit
from tracking.numbers import number
from tracking.pages.section import Section
from tracking.pages.tables import Table, numbers, slug, words
from tracking.report.headline import separation_sentences
from tracking.run_folders.sweep import RunFolder

MOST_INTERVALS = 20
"""Placements whose sampling errors are shown: every pair of them is compared."""


def sampling_error_section(run: RunFolder, ranked: list[str]) -> Section:
    """How much the surrogates would change with other frames."""
    section = Section("Surrogates: sampling error of the POG", columns=2)
    tables = {"sampling_error": run.sampling_error, "pog_resamples": run.pog_resamples}
    missing = [name for name, table in tables.items() if table is None or table.empty]
    if run.sampling_error is None or run.pog_resamples is None or missing:
        names = " and ".join(f"{name}.parquet" for name in missing)
        section.notes.append(f"The run folder has no {names}.")
        return section
    section.notes.append(
        "The POG is counted over some frames and not over all traffic. Blocks of consecutive "
        "frames of a route were drawn again with replacement, the same for every placement. "
        "Intervals are 1.96 standard deviations to each side, nominally 95 % and somewhat less "
        "with few blocks. Entropies from few frames are too low; the estimated bias is taken off "
        "the interval, not off the value."
    )
    section.notes += studied(run, run.sampling_error)
    known = set(run.sampling_error["placement"])
    shown = [name for name in ranked if name in known][:MOST_INTERVALS]
    if len(shown) < len(known):
        section.notes.append(
            f"The best {len(shown)} of {len(known):,} placements; sampling_error.parquet has all."
        )
    best, draws = (
        table[table["placement"].isin(shown)] for table in (run.sampling_error, run.pog_resamples)
    )
    resamples = dict(by_setting(draws, run.axes))
    for title, part in by_setting(best, run.axes):
        pairs = paired_differences(
            part[part["surrogate"].isin(HEADLINE_SURROGATES)], resamples[title]
        )
        for name, own in part.groupby("class", sort=False):
            label = f"{name} · {title}" if title else str(name)
            section.notes += separation_sentences(pairs[pairs["class"] == name], label)
            section.figures.append(
                intervals(own, label, [name for name in run.placements if name in shown])
            )
            section.tables.append(sampling_error_table(own, label))
    return section


def sampling_error_table(estimates: pd.DataFrame, title: str) -> Table:
    """Estimates of `lidarplace.pog.surrogates.sampling_error` of one class as text."""
    columns = [
        words("surrogate", show=surrogate_label),
        words("placement"),
        numbers("value", "value", number),
        numbers("sd", "sd", number),
        numbers("bias", "bias", number),
        numbers("95 % low", "low", number),
        numbers("95 % high", "high", number),
    ]
    order = in_order(estimates["surrogate"])
    rows = estimates.sort_values(
        "surrogate", key=lambda names: names.map(order.index), kind="stable"
    )
    caption = f"Sampling error · {title}"
    if "blocks" in estimates:
        caption += (
            f" · {estimates['resamples'].iloc[0]} draws of {estimates['blocks'].iloc[0]} blocks"
        )
    units = [surrogate_unit(name) for name in estimates["surrogate"]]
    return Table.of(
        caption,
        rows,
        columns,
        wide=True,
        name=slug("sampling error", title),
        data=estimates.assign(unit=units),
    )
