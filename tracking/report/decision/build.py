"""Decision page of a run folder, `decision.html`."""

import re
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from lidarplace.command_line.invocation import command
from tracking.figures.kit.side_by_side import side_by_side
from tracking.findings.summary import for_comparison
from tracking.kitti_iou import at_headline_iou
from tracking.labels import percent
from tracking.pages.html_page import FOLDER, write_page
from tracking.pages.section import Section
from tracking.report.analysis import Analysis
from tracking.report.decision.rigs import picture_section, rigs_section
from tracking.report.decision.where_blind import where_blind_section
from tracking.report.headline import class_label, headline_label
from tracking.report.recommendation import Recommendation
from tracking.report.sections.requirements import rigs_requirements_section

FILE = "decision.html"
_CSV_FILES = re.compile("best|placements|recall-by-direction|ap-by-distance|failures|requirements")
"""Names of the CSV files that hold the numbers of the page."""


def write_decision(
    analysis: Analysis, extent: str, warnings: Sequence[str], failures: Section | None
) -> Path | None:
    """Write the page into the folder of the run, or remove that of an earlier run.

    The first group with results is drawn. None without results: there is nothing to decide by.
    `failures` is the section of what the best rig and the next one find alone."""
    run = analysis.run
    if (answer := analysis.answer) is None:
        (run.path / FILE).unlink(missing_ok=True)
        return None
    first = analysis.recommended[0]
    recall = recall_and_ap_section(first, analysis.means, answer.enough)
    blind = where_blind_section(first)
    short = failures and Section(failures.title, failures.notes[:2], links=failures.links)
    rigs = run.path / "rigs.yaml"  # which older run folders do not have
    required = rigs_requirements_section(run, first.drawn, first.group.setting)
    with_mounts = all(run.placements[name] for name in first.drawn)
    pictures = [picture_section(first, analysis.pair), rigs_section(first)] if with_mounts else []
    parts = (*pictures[:1], recall, *pictures[1:], required, blind, short)
    steps = [("mount the LiDARs as in “Where the LiDARs sit”", "")] if answer.enough else []
    if answer.command:
        steps.append(("add the missing evidence; finished trials are reused", answer.command))
    if rigs.exists():
        by_hand = "move LiDARs of these rigs by hand, and see at once what changes"
        steps.append((by_hand, command("studio", str(rigs))))
    return write_page(
        run.path / FILE,
        Path(__file__).with_name("decision.html"),
        [part for part in parts if part is not None],
        name=run.sweep.name,
        extent=extent,
        answer=answer,
        required=first.required,
        warnings=warnings,
        tables=sorted(
            f.name for f in (run.path / FOLDER).glob("*.csv") if _CSV_FILES.match(f.name)
        ),
        dashboard=None if run.sweep.detections else command("dashboard", str(run.path)),
        next_steps=[{"what": step, "line": line} for step, line in steps],
    )


def recall_and_ap_section(
    recommended: Recommendation, means: pd.DataFrame, enough: bool
) -> Section:
    """Draw AP of every class and the recall of all objects with intervals, the best rig on top.

    With `enough` evidence it also says how likely each rig is to be the best."""
    compared, columns = for_comparison(recommended.group.of(means)), {}
    results, ranking = recommended.run.results, recommended.ranking
    for name in ranking:
        metric = headline_label(results, name)
        label = metric if len(ranking) <= 2 else f"{metric}, {class_label(name)}"
        table = at_headline_iou(compared, results, name).set_index("placement")
        columns[label] = table[["mean", "low", "high"]]
    rows = recommended.drawn
    odds = [percent(share) for share in recommended.best.sure.loc[rows]] if enough else []
    note = (
        "Means over seeds. Bars are 95 % intervals for a comparison, over seeds"
        + (" and over test objects, which all rigs share." if recommended.best.sample else ".")
        if any(table["low"].notna().any() for table in columns.values())
        else "One seed each: the training noise is unknown, so there are no bars."
    )
    plot = side_by_side(columns, rows, "Recall and AP", "percent", odds)
    return Section("What they find", [note], [plot], columns=1)
