"""The section of a sweep without detectors: do the surrogates agree?"""

import pandas as pd
import plotly.graph_objects as go

from tracking.figures.kit.style import figure, text
from tracking.figures.of_sweeps.heat_map import add_coefficients
from tracking.findings.groups import has_detectors
from tracking.findings.paired import with_sums
from tracking.findings.summary import surrogates_of
from tracking.labels import in_order, surrogate_name
from tracking.numbers import signed
from tracking.pages.section import Section
from tracking.report.analysis import Analysis


def agreement_section(found: Analysis) -> Section | None:
    """Rank agreement of the surrogates; None for a sweep that trained a detector."""
    run = found.run
    if has_detectors(run):
        return None
    section = Section(
        "Do the surrogates agree?", ["Spearman's ρ between surrogates, over all placements."]
    )
    sums = with_sums(run.surrogates, run.axes)
    names = (*run.classes, "all") if len(run.classes) > 1 else run.classes
    for group in found.groups:
        for name in names:
            title = "Sum of the classes" if name == "all" else text(name)
            title += f" · {text(group.title)}" if group.varies else ""
            plot = surrogate_agreement(surrogates_of(sums, group.setting, name), title)
            if plot is not None:
                section.figures.append(plot)
    if not section.figures:
        section.notes = ["Fewer than 3 placements: no rank agreement."]
    return section


def surrogate_agreement(surrogates: pd.DataFrame, title: str) -> go.Figure | None:
    """Do the surrogates rank the placements alike? Surrogates as rows and columns.

    Args:
        surrogates: placements as rows, surrogates as columns (`surrogates_of`).
        title: plotly text.

    Returns:
        None for fewer than 3 placements, or fewer than 2 surrogates that vary over them.
    """
    own = surrogates[in_order(surrogates.columns)].dropna(axis="columns", how="all")
    own = own.loc[:, own.nunique() > 1]
    if len(own) < 3 or own.shape[1] < 2:
        return None
    rho = own.corr("spearman")
    names = [surrogate_name(str(name)) for name in rho.columns]
    plot = figure(title, height=132 + 30 * len(rho), margin={"l": 120, "r": 8, "t": 48, "b": 84})
    add_coefficients(plot, rho, names, names, rho.map(signed))
    return plot
