"""Published results of the paper next to those of the sweep."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import astuple, replace

import numpy as np
import pandas as pd

from lidarplace import PAPER_PLACEMENTS
from lidarplace.base.metrics import headline_metric
from lidarplace.rigs.placement import Mount
from tracking.findings.correlation import correlate
from tracking.findings.groups import by_setting
from tracking.findings.surrogate_accuracy import rank_agreement
from tracking.labels import in_order, metric_label, number, setting_label, signed, surrogate_label
from tracking.pages.section import METRIC, Section, Table, numbers, words
from tracking.published import TABLES, published_detection, published_surrogates
from tracking.report.analysis import Analysis
from tracking.report.headline import class_label
from tracking.report.sections.correlation import correlation_table
from tracking.run_folders.sweep import RunFolder

_HOW_TO_READ = (
    "AP and recall that the paper published (CVPR 2022, one training each, in CARLA), for those "
    "of its eight placements that this sweep has, against the surrogates of this sweep and its "
    "traffic. Square is published for its three densities only and is left out. The intervals "
    "of the coefficients do not include the spread over seeds."
)
DIGITS = 6  # of metres and radians by which mounts are compared: a micrometre, a microradian


def published_section(analysis: Analysis) -> Section | None:
    """Compare published AP and recall with surrogates, and with own AP and recall.

    None if the sweep has fewer than two of the placements that the paper published."""
    run = analysis.run
    published = _of_run(run)
    if published["placement"].nunique() < 2:
        return None
    section = Section("The paper's published results", [_HOW_TO_READ])
    tests = []
    for title, part in by_setting(run.surrogates, run.axes):
        correlations = correlate(published, part)
        tests.append(correlations[correlations["n"] > 0].assign(setting=title))
    pairs = _beside_own(published, analysis.means, run)
    if len(pairs):
        section.notes.append(
            "Own results are next to those of the same network; the paper's training data, "
            "scale and clouds differ, so compare the order, not the level."
        )
        section.notes += _orders(pairs)
        section.tables.append(_beside_table(pairs))
    section.tables.append(_published_table(published))
    everything = pd.concat(tests)
    if len(everything):
        table = correlation_table(everything, ["setting"])
        caption = "Published AP and recall: all coefficients, 95 % intervals in brackets"
        section.tables.append(replace(table, name="published-coefficients", caption=caption))
    add_published_surrogates(section)
    return section


def paper_names(placements: Mapping[str, Sequence[Mount]]) -> dict[str, str]:
    """Name the placement that has the mounts of each of the paper's eight; a namesake first."""
    rigs = {name: rounded(mounts) for name, mounts in placements.items()}
    by_paper_name = {}
    for paper, placement in PAPER_PLACEMENTS.items():
        same = [name for name, rig in rigs.items() if rig == rounded(placement.mounts)]
        if same:
            by_paper_name[paper] = paper if paper in same else same[0]
    return by_paper_name


def rounded(mounts: Sequence[Mount]) -> list[tuple[float, ...]]:
    """Round mounts to numbers that are the same for equal rigs, whatever their order."""
    return sorted(tuple(round(value, DIGITS) + 0.0 for value in astuple(m)) for m in mounts)


def _of_run(run: RunFolder) -> pd.DataFrame:
    """Select published results of the run's placements and classes, in the columns of results."""
    table = published_detection()
    table = table[table["density"] == ""].drop(columns="density")
    names = paper_names(run.placements)
    table = table[table["placement"].isin(names) & table["class"].isin([*run.classes, "all"])]
    # Figures that the paper repeats in several tables are the same.
    table = table.drop_duplicates(["metric", "class", "iou", "detector", "placement"])
    return table.assign(placement=table["placement"].map(names), seed=0, difficulty="all")


def _orders(pairs: pd.DataFrame) -> Iterator[str]:
    """Say how alike own and published headlines rank the placements, a sentence for each."""
    headlines = pairs[pairs["metric"] == pairs["class"].map(headline_metric)]
    for _, part in headlines.groupby(["class", "metric", "iou", "series"], sort=False):
        name, metric, iou, series = part.iloc[0][["class", "metric", "iou", "series"]]
        rho = rank_agreement(part["mean"], part["value"])[0]
        if np.isfinite(rho):
            yield (
                f"{class_label(name)}, {metric_label(metric, iou)}, {series}: Spearman's ρ of own "
                f"and published results is {signed(rho)} over {len(part)} placements."
            )


def _beside_own(published: pd.DataFrame, means: pd.DataFrame, run: RunFolder) -> pd.DataFrame:
    """Add mean, low and high of the same network here to rows of `published`, and `series`."""
    keys = ["placement", "class", "metric", "iou"]
    tested = means[means["seeds"] > 0]
    columns = ["mean", "low", "high", "detector", *run.axes]
    networks = [name.removesuffix("_paper").removesuffix("_tiny") for name in tested["detector"]]
    tested = tested.assign(network=networks)[[*keys, "network", *columns]]
    tested = tested.rename(columns={"detector": "own_detector"})
    pairs = published.merge(tested, left_on=[*keys, "detector"], right_on=[*keys, "network"])
    series = [
        " · ".join(filter(None, (row["own_detector"], setting_label(run.axes, row))))
        for row in pairs.to_dict("records")
    ]
    return pairs.assign(series=series)


def _beside_table(pairs: pd.DataFrame) -> Table:
    cells = [
        words("class"),
        METRIC,
        words("detector", "series"),
        words("placement"),
        numbers("published (%)", "value", ".1f"),
        numbers("own (%)", "mean", ".1f"),
    ]
    columns = ["class", "metric", "iou", "detector", "series", "placement", "value", "mean"]
    data = pairs[[*columns, "low", "high"]].rename(
        columns={"value": "published (%)", "mean": "own (%)", "low": "own_low (%)"}
        | {"high": "own_high (%)"}
    )
    return Table.of("Published and own", pairs, cells, name="published-and-own", data=data)


def _published_table(published: pd.DataFrame) -> Table:
    placements = list(dict.fromkeys(published["placement"]))
    keys = ["class", "metric", "iou", "detector"]
    wide = published.pivot(index=keys, columns="placement", values="value")[placements]
    wide = wide.loc[list(dict.fromkeys(published[keys].itertuples(index=False, name=None)))]
    data = published[["table", *keys, "placement", "value"]].rename(columns={"value": "value (%)"})
    columns = [words("class", show=class_label), METRIC, words("detector")]
    columns += [numbers(name, name, ".2f") for name in placements]
    data = data.assign(table=data["table"].map(TABLES))
    return Table.of("Published (%)", wide.reset_index(), columns, name="published", data=data)


_CLASS = "Car"
"""Class of which the paper printed surrogates of several placements and densities."""
_KEYS = ["class", "metric", "iou", "detector"]


def add_published_surrogates(section: Section) -> None:
    """Add the coefficients over placements, and over densities of Square."""
    correlations = correlate(*_printed_both(), ["over"])
    section.notes.append(
        f"The paper's own surrogates, those of its traffic, are printed for {_CLASS}: S-MIG of "
        "five placements, and S-MIG, H_POG and IG of Square at three densities. Of three points "
        "no coefficient has a two-sided p-value below 0.33."
    )
    table = correlation_table(correlations[correlations["spearman"].notna()], ["over"])
    caption = "The paper's own surrogates with its own AP, 95 % intervals in brackets"
    section.tables.append(replace(table, name="published-surrogates", caption=caption))


def published_density_table() -> Table:
    """Show AP of Square and its surrogates, as the paper printed them, a column a density."""
    results, surrogates = (table[table["over"] == "densities"] for table in _printed_both())
    densities = list(dict.fromkeys(results["placement"]))[::-1]
    keys = ["metric", "iou", "detector"]
    wide = results.pivot(index=keys, columns="placement", values="value")[densities]
    rows = [
        (f"{detector} · {metric_label(metric, iou)} (%)", *map("{:.2f}".format, values))
        for (metric, iou, detector), values in zip(wide.index, wide.to_numpy(), strict=True)
    ]
    by_density = surrogates.pivot(index="surrogate", columns="placement", values="value")[densities]
    rows += [
        (surrogate_label(n), *map(number, by_density.loc[n])) for n in in_order(by_density.index)
    ]
    of_results = results[["detector", "metric", "iou", "placement", "value"]]
    data = pd.concat([of_results, surrogates[["surrogate", "placement", "value"]]])
    return Table(
        f"Published · {_CLASS}, Square",
        ("", *densities),
        tuple(rows),
        name="published-density",
        data=data.rename(columns={"placement": "density", "value": "value (% or nats)"}),
    )


def _printed_both() -> tuple[pd.DataFrame, pd.DataFrame]:
    """Read results and surrogates as `correlate` takes them; `over` says what `placement` holds."""
    results, surrogates = (
        _over(table[table["class"] == _CLASS])
        for table in (published_detection(), published_surrogates())
    )
    keys = ["over", "placement"]
    results = results.merge(surrogates[keys].drop_duplicates(), on=keys)
    # Figures that the paper repeats in several tables are the same.
    results = results.drop_duplicates([*keys, *_KEYS])
    return results.assign(seed=0, difficulty="all"), surrogates


def _over(table: pd.DataFrame) -> pd.DataFrame:
    """Add `over`, and put the density in the place of the placement where one was printed."""
    dense = table["density"] != ""
    return table.assign(
        over=dense.map({True: "densities", False: "placements"}),
        placement=table["density"].where(dense, table["placement"]),
    )
