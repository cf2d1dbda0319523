"""Build the decision page of a run folder: `decision.html`."""

import re
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from lidarplace.command_line.invocation import command
from tracking.figures.kit.side_by_side import side_by_side
from tracking.findings.summary import for_comparison
from tracking.kitti_iou import judged
from tracking.labels import percent
from tracking.pages.page import FOLDER, write_page
from tracking.pages.section import Section
from tracking.report.analysis import Analysis
from tracking.report.decision.rigs import picture_section, rigs_section
from tracking.report.decision.where_blind import where_blind_section
from tracking.report.headline import class_label, headline_label
from tracking.report.recommendation import Recommendation
from tracking.report.sections.requirements import rigs_requirements_section
from tracking.run_folders.sweep import RunFolder

FILE = "decision.html"
_SHOWN = re.compile("best|placements|recall-by-direction|ap-by-distance|failures|requirements")
"""CSV files that hold the numbers of the page."""


def write_decision(
    found: Analysis, extent: str, warnings: Sequence[str], failures: Section | None
) -> Path | None:
    """Write the page into the folder of the run, or remove that of an earlier run.

    The first group with results is drawn. None without results: there is nothing to decide by.
    `failures` is the section of what the best rig and the next one find alone.
    """
    run = found.run
    if (said := found.answer) is None:
        (run.path / FILE).unlink(missing_ok=True)
        return None
    first = found.recommended[0]
    recall = recall_and_ap_section(run, first, found.means, said.enough)
    blind = where_blind_section(run, first)
    short = failures and Section(failures.title, failures.notes[:2], links=failures.links)
    rigs = run.path / "rigs.yaml"  # which older run folders do not have
    required = rigs_requirements_section(run, first.shown, first.group.setting)
    known = all(run.placements[name] for name in first.shown)
    drawn = [picture_section(run, first), rigs_section(run, first)] if known else []
    parts = (*drawn[:1], recall, *drawn[1:], required, blind, short)
    steps = [("mount the LiDARs as “Where the LiDARs sit” has them", "")] if said.enough else []
    if said.command:
        steps.append(("add the missing evidence; finished trials are reused", said.command))
    if rigs.exists():
        by_hand = "move LiDARs of these rigs by hand, and see at once what changes"
        steps.append((by_hand, command("studio", str(rigs))))
    return write_page(
        run.path / FILE,
        Path(__file__).with_name("decision.html"),
        [part for part in parts if part is not None],
        name=run.sweep.name,
        extent=extent,
        answer=said,
        required=first.required(run),
        warnings=warnings,
        tables=sorted(f.name for f in (run.path / FOLDER).glob("*.csv") if _SHOWN.match(f.name)),
        dashboard=None if run.sweep.detections else command("dashboard", str(run.path)),
        next_steps=[{"what": what, "line": line} for what, line in steps],
    )


def recall_and_ap_section(
    run: RunFolder, found: Recommendation, means: pd.DataFrame, enough: bool
) -> Section:
    """Every class' AP and the recall of all objects, with intervals, the best rig on top; with
    `enough` evidence also how likely each is to be the best."""
    own, columns = for_comparison(found.group.of(means)), {}
    for name in found.ranked:
        metric = headline_label(run.results, name)
        label = metric if len(found.ranked) <= 2 else f"{metric}, {class_label(name)}"
        table = judged(own, run.results, name).set_index("placement")
        columns[label] = table[["mean", "low", "high"]]
    rows = found.shown
    odds = [percent(share) for share in found.best.sure.loc[rows]] if enough else []
    note = (
        "Means over seeds. Bars are 95 % intervals for a comparison, over seeds"
        + (" and over test objects, which all rigs share." if found.best.sample else ".")
        if any(table["low"].notna().any() for table in columns.values())
        else "One seed each: the training noise is unknown, so there are no bars."
    )
    plot = side_by_side(columns, rows, "Recall and AP", "percent", odds)
    return Section("What they find", [note], [plot], columns=1)
