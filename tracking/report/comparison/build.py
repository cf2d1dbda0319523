"""Build the page that compares several sweeps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd

from lidarplace.base.metrics import METRICS, RANKING, headline_metric
from lidarplace.pog.surrogates.table import HEADLINE_SURROGATES
from tracking.figures.kit.style import text
from tracking.figures.of_sweeps.heat_map import heat_map
from tracking.figures.of_sweeps.side_by_side import side_by_side
from tracking.findings.correlation import correlate
from tracking.findings.promotion import is_full
from tracking.findings.surrogate_accuracy import rank_agreement
from tracking.kitti_iou import headline_iou, judged
from tracking.labels import in_order, metric_label, metric_name, surrogate_name
from tracking.numbers import digits, signed
from tracking.pages.csv_files import FOLDER, write_csv_files
from tracking.pages.markdown import escaped, write_markdown
from tracking.pages.page import write_page
from tracking.pages.section import Section
from tracking.pages.tables import (
    METRIC,
    MOST_ROWS,
    PERCENT,
    SURROGATE,
    Table,
    numbers,
    slug,
    with_units,
    words,
)
from tracking.report.cautions import cautions
from tracking.report.comparison.pooled import pooled_table
from tracking.report.comparison.variants import (
    Variant,
    differing_settings,
    shared_placements,
    sweep_names,
    variants,
)
from tracking.report.headline import class_label
from tracking.report.sections.surrogates_beside import surrogates_beside
from tracking.run_folders.sweep import RunFolder

_NOTHING_SHARED = (
    "These sweeps share no placement (same name and same mounts), so no results stand side by side."
)


def build_comparison(runs: Sequence[Path], target: Path) -> Path:
    """Write `comparison.html`, `comparison.md` and `tables/` into `target`; return the page.

    Args:
        runs: folders that sweeps have left, at least two.
        target: a folder, made if need be.

    Raises:
        ValueError: fewer than two runs, one is given twice or is no run folder, or `target` is a
            file or one of the runs.
    """
    folders = [Path(run) for run in runs]
    if len({folder.resolve() for folder in folders}) < max(2, len(folders)):
        raise ValueError("a comparison needs at least two different run folders")
    if target.resolve() in {folder.resolve() for folder in folders}:
        raise ValueError(f"{target} is one of the sweeps; the comparison needs a folder of its own")
    if target.exists() and not target.is_dir():
        raise ValueError(f"{target} is no folder")
    read = [_of_full_trainings(RunFolder.read(folder)) for folder in folders]
    names = sweep_names(read)
    found = variants(read, names)
    same, other = shared_placements(read)
    notes = [] if same else [_NOTHING_SHARED]
    if other:
        notes.append(
            f"Not compared, as their mounts differ between sweeps: {', '.join(other[:20])}."
        )
    notes += [
        f"{name}: {caution}"
        for run, name in zip(read, names, strict=True)
        for caution in cautions(run)
    ]
    sections = [_sweeps_section(read, names, same), _settings_section(read, names)]
    if same:
        sections += [
            section
            for section in (_results(found, same), _surrogates(found, same), _ranks(found, same))
            if section.tables
        ]
    sections.append(_coefficients(read, names))
    target.mkdir(parents=True, exist_ok=True)
    write_csv_files(target / FOLDER, sections)
    page = write_page(
        target / "comparison.html",
        Path(__file__).with_name("comparison.html"),
        sections,
        name=" / ".join(names),
        warnings=notes,
        shared=len(same),
    )
    commands = "\n".join(run.sweep.command for run in read)
    first = [f"> Warning: {escaped(note)}" for note in notes]
    title, last = " / ".join(names), {"Commands": commands}
    write_markdown(target / "comparison.md", title, first, sections, last, page.name)
    return page


def _of_full_trainings(run: RunFolder) -> RunFolder:
    full = is_full(run.results, run.axes, run.sweep.promote)
    return replace(run, results=run.results[full])


def _sweeps_section(runs: Sequence[RunFolder], names: Sequence[str], same: list[str]) -> Section:
    data = pd.DataFrame(
        {
            "sweep": names,
            "folder": [str(run.path) for run in runs],
            "placements": [len(run.placements) for run in runs],
            "of them shared": [len(set(same) & set(run.placements)) for run in runs],
            "classes": [", ".join(run.classes) for run in runs],
            "detectors": [
                ", ".join(filter(None, dict.fromkeys(run.trials["detector"]))) for run in runs
            ],
            "seeds": [run.trials["seed"].nunique() for run in runs],
            "training frames": [run.sweep.frames.train for run in runs],
            "test frames": [run.sweep.frames.test for run in runs],
        }
    )
    return Section("Sweeps", tables=[_plain("Sweeps", data, {0, 1, 4, 5}, "sweeps")])


def _settings_section(runs: Sequence[RunFolder], names: Sequence[str]) -> Section:
    section = Section("What differs in the configurations")
    settings = differing_settings(runs)
    if not settings:
        section.notes.append("Nothing but names, placements, seeds, detectors and places.")
        return section
    section.notes.append(
        "Keys that differ, with all values of an axis; – is a key that the configuration leaves at "
        "its default. Names, placements, seeds, detectors and places of files are left out."
    )
    rows = [(key, *values) for key, values in settings.items()]
    data = pd.DataFrame(rows, columns=["key", *names])
    section.tables.append(_plain("Settings", data, set(range(len(names) + 1)), "settings"))
    return section


def _cells(found: Sequence[Variant], name: str, metric: str) -> list[pd.DataFrame | None]:
    """Of every variant mean, low, high and seeds by placement; None where there is none."""
    tables: list[pd.DataFrame | None] = []
    for variant in found:
        own = judged(variant.means, variant.run.results, name, metric)
        own = own[own["seeds"] > 0].set_index("placement")
        tables.append(own if len(own) else None)
    return tables


def _classes(found: Sequence[Variant]) -> list[str]:
    return list(dict.fromkeys([c for variant in found for c in variant.run.classes] + ["all"]))


def _sweeps(found: Sequence[Variant], columns: Mapping[str, object]) -> int:
    """How many sweeps `columns`, by title of the variant, are from."""
    return len({variant.sweep for variant in found if variant.title in columns})


def _results(found: Sequence[Variant], same: list[str]) -> Section:
    section = Section("AP and recall of the shared placements", columns=2)
    section.notes.append(
        "Means over seeds, percent, with 95 % intervals. Levels differ with the scenes, the "
        "training and the detector; what can be compared is the order of the placements."
    )
    for name in _classes(found):
        for metric in RANKING:
            tables = _cells(found, name, metric)
            columns = {
                variant.title: table.reindex(same)
                for variant, table in zip(found, tables, strict=True)
                if table is not None and table.index.isin(same).any()
            }
            if _sweeps(found, columns) < 2:
                continue
            first, *others = dict.fromkeys(own["iou"].dropna().iloc[0] for own in columns.values())
            label = " / ".join([metric_label(metric, first), *(f"{iou:g}" for iou in others)])
            heading = f"{class_label(name)} · {label}"
            if METRICS[metric].headline:
                plot = side_by_side(columns, same, text(heading), f"{label} (%)")
                section.figures.append(plot)
            rows = tuple(
                (
                    placement,
                    *(digits(v, ".1f") for v in values),
                )
                for placement, values in zip(
                    same, np.stack([own["mean"] for own in columns.values()], axis=1), strict=True
                )
            )
            data = pd.concat(
                own[["mean", "low", "high", "seeds"]].assign(variant=title).reset_index()
                for title, own in columns.items()
            )
            table = Table(
                f"{heading} (%)",
                ("placement", *columns),
                rows,
                name=slug("results", heading),
                data=with_units(data, PERCENT),
            )
            section.tables.append(table.first(MOST_ROWS))
    return section


def _surrogates(found: Sequence[Variant], same: list[str]) -> Section:
    section = Section(
        "Surrogates of the shared placements",
        ["Each sweep has its own traffic, so values differ; the order can be compared."],
    )
    for name in _classes(found):
        # Detectors share surrogates: one column for every different one.
        columns: dict[str, pd.DataFrame] = {}
        for variant in found:
            table = variant.surrogates(name).reindex(same)
            known = any(table.equals(other) for other in columns.values())
            if table.notna().any(axis=None) and not known:
                columns[variant.title] = table
        tables = columns.values()
        shown = in_order(s for s in HEADLINE_SURROGATES if sum(s in t for t in tables) > 1)
        if shown and _sweeps(found, columns) > 1:
            heading = "Sum of the classes" if name == "all" else name
            slugged = slug("surrogates", heading)
            section.tables.append(surrogates_beside(columns, shown, same, heading, slugged))
    return section


def _ranks(found: Sequence[Variant], same: list[str]) -> Section:
    section = Section(
        "Do the sweeps rank placements alike?",
        ["Spearman's ρ and Kendall's τ over the placements that both have; at least 3."],
    )
    rows = []
    for name in _classes(found):
        metric = headline_metric(name)
        measured = [
            None if table is None else table["mean"] for table in _cells(found, name, metric)
        ]
        values = {metric_name(metric): measured}
        for surrogate in HEADLINE_SURROGATES:
            tables = [variant.surrogates(name) for variant in found]
            values[surrogate_name(surrogate)] = [
                table[surrogate].dropna() if surrogate in table else None for table in tables
            ]
        for what, series in values.items():
            for i, j in combinations(range(len(found)), 2):
                a, b = series[i], series[j]
                if a is None or b is None or (what != next(iter(values)) and a.equals(b)):
                    continue
                common = [p for p in same if p in a.index and p in b.index]
                rho, tau = rank_agreement(a.reindex(common), b.reindex(common))
                if not np.isnan(rho):
                    titles = (found[i].title, found[j].title)
                    rows.append((name, what, *titles, len(common), rho, tau))
    data = pd.DataFrame(rows, columns=["class", "what", "one", "other", "n", "spearman", "kendall"])
    columns = [
        words("class"),
        words("", "what"),
        words("one"),
        words("other"),
        numbers("n", "n", ""),
        numbers("Spearman ρ", "spearman", signed),
        numbers("Kendall τ", "kendall", signed),
    ]
    if rows:
        table = Table.of(
            "Rank agreement between sweeps",
            data,
            columns,
            wide=True,
            name="rank-agreement",
        )
        section.tables.append(table.first(2 * MOST_ROWS))
    return section


def _coefficients(runs: Sequence[RunFolder], names: Sequence[str]) -> Section:
    section = Section("Coefficients of every sweep", columns=2)
    section.notes.append(
        "Spearman's ρ of the surrogates with 3D AP, and with recall of all, over all placements of "
        "each sweep. A star: p below 0.05 after Holm's correction within the sweep."
    )
    tests = (_headline_tests(run).assign(sweep=n) for run, n in zip(runs, names, strict=True))
    known = [own for own in tests if len(own)]
    if not known:
        section.notes = ["No sweep has a coefficient."]
        return section
    table = pd.concat(known)
    shown = table[table["surrogate"].isin(HEADLINE_SURROGATES)]
    for name in dict.fromkeys(shown["class"]):
        own = shown[shown["class"] == name]
        labels = [
            f"{row['sweep']} · {row['setting']} · {metric_label(row['metric'], row['iou'])}"
            for row in own.to_dict("records")
        ]
        plot = heat_map(own, labels, f"ρ · {text(class_label(name))}")
        section.figures += [plot] if plot is not None else []
    pooled = pooled_table(runs)
    if pooled is not None:
        section.notes.append(
            "Pooled: values are ranked within each sweep, detector and setting, and the ranks "
            "centred there, so the level of a sweep (its fixed effect) does not count. The same "
            "placements come back in several sweeps, which are therefore no independent draws: "
            "the pooled coefficient has neither a p-value nor an interval."
        )
        section.tables.append(pooled)
    section.tables.append(_coefficient_table(table, shown).first(2 * MOST_ROWS))
    return section


def _headline_tests(run: RunFolder) -> pd.DataFrame:
    """Rows of `correlate` for the headline metrics, with `setting`: detector and axes."""
    own = correlate(run.results, run.surrogates, run.axes)
    records = own.to_dict("records")
    headline = [
        row["iou"] == headline_iou(run.results, row["class"])
        and row["metric"] == headline_metric(row["class"])
        for row in records
    ]
    settings = [
        ", ".join([str(row["detector"]), *(f"{a} = {row[a]}" for a in run.axes)]) for row in records
    ]
    return own.assign(setting=settings)[headline]


def _coefficient_table(table: pd.DataFrame, shown: pd.DataFrame) -> Table:
    """`shown` to be read; its file has all of `table`."""
    keep = ["sweep", "setting", "class", "metric", "iou", "surrogate", "n", "seeds"]
    kinds = ("pearson", "spearman", "kendall")
    keep += [f"{kind}{end}" for kind in kinds for end in ("", "_low", "_high", "_p", "_holm")]
    columns = [
        words("sweep"),
        words("detector", "setting"),
        words("class"),
        METRIC,
        SURROGATE,
        numbers("n", "n", ""),
        numbers("Spearman ρ", "spearman", signed),
        numbers("p", "spearman_p", ".2g"),
    ]
    caption = "Coefficients by sweep"
    return Table.of(caption, shown, columns, wide=True, name="coefficients", data=table[keep])


def _plain(caption: str, data: pd.DataFrame, words: set[int], name: str) -> Table:
    rows = tuple(tuple(str(cell) for cell in row) for row in data.itertuples(index=False))
    return Table(
        caption, tuple(data.columns), rows, words=frozenset(words), wide=True, name=name, data=data
    )
