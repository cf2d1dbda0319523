"""Page of the cheapest rig, `cheapest.html`: the rig, why it needs each LiDAR, proof and prices."""

import json
import math
from collections import Counter
from pathlib import Path

from lidarplace.command_line.invocation import command, with_settings
from lidarplace.mounting.outline import outline
from lidarplace.requirements.tables import Ground
from sweeps.configuration.objective import TOTALS
from sweeps.results.rigs import FILE as RIGS
from sweeps.search.cheapest.result import FILE, CheapestAnswer, as_json, cost_text
from sweeps.search.cheapest.rig_check import cost_of
from sweeps.search.problem.rig import Rig
from sweeps.search.problem.zone_records import zones_of
from tracking.figures.kit.grounds import ground_note, with_grounds_of_folder
from tracking.figures.kit.rig_picture import PicturedRig, axes_and_posts, rig_picture
from tracking.figures.kit.style import OUTLINE, colour, figure, legend_below
from tracking.labels import digits
from tracking.pages.html_page import write_page
from tracking.pages.requirements import alone, draw_verdicts, verdict_table
from tracking.pages.section import Section, Table
from tracking.run_folders.arrays import Grounds
from tracking.run_folders.search_json import Command
from tracking.search_report.build import PAGE
from tracking.search_report.headline import Card, pairs_sentence


def write_cheapest_page(answer: CheapestAnswer, folder: Path) -> Path:
    """Write the page into `folder` and return its path."""
    sections = [_picture(answer, folder), _proof(answer), _lidars(answer), _prices(answer)]
    sections.append(_requirements(answer))
    file = answer.problem.file
    return write_page(
        folder / FILE,
        PAGE,
        [section for section in sections if section is not None],
        name=f"{file.name}: least {file.search.cheapest.by}",
        summary=f"{len(answer.problem.space.models)} models, "
        f"{answer.chosen.counts.get('candidates', 0):,} candidate mounts, "
        f"requirements: {len(file.search.requirements)}",
        answer=_card(answer),
        next_steps=_next_steps(answer, folder),
        warnings=[],
        command=answer.command,
        config=None,
        facts=json.dumps(as_json(answer), indent=1),
    )


def _card(answer: CheapestAnswer) -> Card:
    """State the cost of the rig and its proof; or what the closest rig lacks."""
    lines = [answer.proof, *filter(None, [answer.refined])]
    if answer.rig is None:
        lines += [_lacks(answer)] if answer.listed else ["No candidate keeps the constraints."]
        return Card("Result", "No rig passes", tuple(lines))
    if answer.mirrored:
        lines.append(pairs_sentence(answer.mirrored))
    if len(answer.worst):
        first = answer.worst.iloc[0]
        lines.append(
            f"Least to spare: {first['requirement']}, {first['value']:.3g} of the "
            f"{first['at_least']:g} {first['measure']} that are needed."
        )
    cost = cost_text(answer.problem, cost_of(answer.rig, answer.problem))
    by = answer.problem.file.search.cheapest.by
    proven = "proven for the grid" if answer.chosen.gap == 0.0 else "not proven"
    return Card(f"Least {by}, {proven}: {cost}", _models(answer.rig), tuple(lines))


def _lacks(answer: CheapestAnswer) -> str:
    """Say what the closest rig lacks, a sentence."""
    lacks = [
        f"{row['requirement']} has {row['value']:.3g} of {row['at_least']:g} {row['measure']}"
        for row in answer.worst.to_dict("records")
        if not row["met"]
    ]
    lacks += [f"it breaks {name}" for name in answer.broken]
    return f"Of the rigs that were checked this one is closest: {'; '.join(lacks)}."


def _models(rig: Rig) -> str:
    """Count the LiDARs of a rig by model, such as "2 × xt32, 1 × bpearl"."""
    return ", ".join(f"{n} × {model}" for model, n in Counter(c.model for c in rig).items())


def _next_steps(answer: CheapestAnswer, folder: Path) -> list[Command]:
    steps = []
    if answer.chosen.gap > 0.0 and answer.chosen.bound < math.inf:
        seconds = {"search.cheapest.seconds": 4 * answer.problem.file.search.cheapest.seconds}
        line = with_settings(answer.command, seconds)
        steps.append(Command(what="give the proof more time", line=line))
    if answer.rig is not None:
        line = command("studio", str(folder / RIGS))
        steps.append(Command(what="move its LiDARs by hand", line=line))
    return steps


def _picture(answer: CheapestAnswer, folder: Path) -> Section:
    """Draw the vehicle with the rig, and the one of the grid in the menu; or the closest one."""
    if not answer.listed:
        return Section("The rig", place="picture")
    rigs = {answer.name: answer.listed}
    if answer.refined:
        rigs["before refinement"] = answer.chosen.rig or ()
    pictured = {
        name: PicturedRig.in_zones(*zip(*((c.mount, c.model, c.zone) for c in rig), strict=True))
        for name, rig in rigs.items()
    }
    vehicle, zones = answer.problem.criteria.carrier.vehicle, zones_of(answer.problem.space)
    pictured = with_grounds_of_folder(pictured, folder, answer.problem.file.classes, vehicle)
    picture = rig_picture(pictured, vehicle, zones)
    notes = [axes_and_posts(vehicle), ground_note(pictured)]
    return Section("The rig", [*filter(None, notes)], [picture], place="picture")


def _lidars(answer: CheapestAnswer) -> Section | None:
    if not answer.listed:
        return None
    head, rows = answer.lidar_rows()
    words = frozenset({0, 1, 2} if answer.rig is None else {0, 1, 2, 3})
    cells = tuple(map(tuple, rows))
    table = Table("Mounts in metres and degrees", tuple(head), cells, words=words, wide=True)
    if answer.rig is None:
        return Section("The closest rig", [_lacks(answer)], tables=[table])
    note = (
        "A requirement in the table fails first without the LiDAR; where none does, without the "
        "LiDAR and its mirror image."
    )
    return Section("Why each LiDAR is there", [note], tables=[table])


def _proof(answer: CheapestAnswer) -> Section | None:
    """Draw the cost below which no rig of the grid is, and the gap between it and the rig."""
    chosen, problem = answer.chosen, answer.problem
    if not 0.0 < chosen.bound < math.inf:
        return None
    by, listed = problem.file.search.cheapest.by, cost_text(problem, chosen.bound)
    title = {"power": "power (W)", "height": "height of the highest LiDAR (m)"}.get(by, by)
    plot = figure("", height=150, margin={"l": 16, "t": 8, "b": 48}, barmode="stack")
    parts = [(f"no rig of the grid costs less than {listed}", chosen.bound, colour(0))]
    if chosen.gap > 0.0 and answer.rig is not None:
        gap = f"gap: such a rig may exist ({100 * chosen.gap:.3g} %)"
        parts.append((gap, chosen.cost - chosen.bound, colour(1)))
    for name, length, shade in parts:
        bar = {"x": [length], "y": [""], "orientation": "h", "marker": {"color": shade}}
        plot.add_bar(**bar, name=name, hovertext=name, hoverinfo="text", showlegend=True)
    if answer.rig is not None:
        cost = cost_of(answer.rig, problem)
        marker = {"symbol": "diamond", "size": 13, "color": OUTLINE}
        name = f"the rig: {cost_text(problem, cost)}"
        plot.add_scatter(x=[cost], y=[""], mode="markers", marker=marker, name=name)
    plot.update_xaxes(title=title, rangemode="tozero")
    plot.update_yaxes(visible=False)
    return Section("Proof", [], [legend_below(plot)], columns=1)


def _prices(answer: CheapestAnswer) -> Section | None:
    """List prices and watts by LiDAR model and zone, and of further sensors; sums last."""
    carrier, rig = answer.problem.criteria.carrier, answer.listed
    if not rig:
        return None
    price, power = (carrier.totals[by] for by in TOTALS)
    rows: list[tuple[str, int, float, float, float, float]] = []
    for (model, zone), count in Counter((c.model, c.zone) for c in rig).items():
        mount = carrier.mount_prices.get(zone, 0.0)
        sums = count * (price[model] + mount), count * power[model]
        rows.append((f"{model}, {zone or 'fixed'}", count, price[model], mount, *sums))
    for sensor in answer.problem.file.search.further_settings:
        cost = sensor.price or 0.0
        rows.append((sensor.name or sensor.KIND, 1, cost, 0.0, cost, sensor.power or 0.0))
    cost, watts = (carrier.total_of(by, rig) for by in TOTALS)
    rows.append(("together", sum(row[1] for row in rows), math.nan, math.nan, cost, watts))
    head = ("LiDAR and zone", "number", "price each", "mount each", "price", "power (W)")
    cells = tuple((str(first), *(digits(n, ",.6g") for n in rest)) for first, *rest in rows)
    table = Table("Prices are in the currency of the configuration", head, cells)
    return Section("Price list", tables=[table.without_dashes()])


def _requirements(answer: CheapestAnswer) -> Section | None:
    """Show every requirement of the rig in its worst case, and the ground around the vehicle."""
    if not len(answer.worst):
        return None
    outcomes, carrier = answer.check.outcomes, answer.problem.criteria.carrier
    table = verdict_table(answer.worst, [])
    section = Section("Requirements", [alone(carrier.vehicle)], tables=[table])
    names = [result.requirement.name for result in outcomes]
    grounds = {answer.name: [Ground.of(result) for result in outcomes]}
    every = Grounds.of(outline(carrier.vehicle), names, grounds)
    mounts = {answer.name: [lidar.mount for lidar in answer.listed]}
    worst = answer.worst.assign(rig=answer.name)
    draw_verdicts(section, worst, "rig", [answer.name], mounts, every, carrier.vehicle)
    return section
