"""Page of a search, `search.html`, from its run folder."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from lidarplace.requirements.tables import worst_cases
from tracking.figures import of_searches
from tracking.figures.kit.grounds import ground_note, with_grounds_of_folder
from tracking.figures.kit.rig_picture import PicturedRig, axes_and_posts, rig_picture
from tracking.figures.kit.vehicle_lines import has_body, name_of
from tracking.labels import DASH, digits, number
from tracking.pages.html_page import write_page
from tracking.pages.requirements import alone, counted, draw_verdicts, verdict_table
from tracking.pages.section import MOST_ROWS, Section, Table
from tracking.run_folders.search import SearchFolder
from tracking.run_folders.search_json import Rig
from tracking.search_report import headline, tables
from tracking.search_report.cautions import cautions
from tracking.search_report.feasibility import constraint_table, infeasible_sentences, nearest_trial

PAGE = Path(__file__).with_name("search.html")
"""Template of the pages of a search and of the cheapest rig."""
MOST_RIGS = 12
"""Rigs of a front whose mounts are listed; the picture's menu is filled up to as many."""
MOST_BEST = 4
"""Best rigs that the picture's menu always has, in addition to greedy's and the paper's."""


def build_search_report(folder: Path) -> Path:
    """Write `search.html` into the run folder of a search and return its path.

    One file that loads nothing from a network, see `tracking.pages.html_page`. What the search did
    not make is left out. Raises ValueError: `folder` is no folder of a search, see
    `SearchFolder.read`."""
    run = SearchFolder.read(folder)
    search = run.search
    parts: list[Callable[[SearchFolder], Section | None]]
    parts = [_picture, _mounts, _chosen, _unseen, _history, _pareto, _constraints]
    parts += [_requirements, _robustness, _verified, _parameters]
    return write_page(
        run.path / "search.html",
        PAGE,
        name=search.name,
        summary=headline.summary(search),
        command=search.command,
        answer=headline.answer(run),
        next_steps=headline.next_steps(run),
        warnings=cautions(run),
        sections=[section for part in parts if (section := part(run)) is not None],
        config=run.config,
        facts=json.dumps(search.model_dump(exclude={"rigs", "commands", "site"}), indent=2),
    )


def _mounts(run: SearchFolder) -> Section | None:
    search, best = run.search, _best(run)
    if not best:
        return None
    section = Section("Where the LiDARs sit")
    for name, rig in list(best.items())[:MOST_RIGS]:
        values = [(o, rig.value(o)) for o in search.objectives]
        values_of_rig = [
            f"{o.name} {headline.with_unit(o, value)}" for o, value in values if not np.isnan(value)
        ]
        caption = " · ".join(filter(None, (name, ", ".join(values_of_rig))))
        section.tables.append(tables.mount_table(caption, rig))
    if len(search.best) > MOST_RIGS:
        section.notes.append(
            f"The first {MOST_RIGS} of the {len(search.best):,} rigs of the front that search.json "
            "holds."
        )
    body = run.search.body
    frame = "Ego frame" if has_body(body) else "Frame of the site"
    section.notes.append(
        f"{frame}: x forward, y left, z up, origin on the ground in the middle of "
        f"{name_of(body)}. Pitch > 0 tips the nose down, roll > 0 lifts the left side."
    )
    return section


def _best(run: SearchFolder) -> dict[str, Rig]:
    """Select the best rigs; the nearest where none is feasible; none where no trial has a rig."""
    if run.search.best:
        return {name: run.search.rigs[name] for name in run.search.best}
    trial = nearest_trial(run)
    if trial is None or (rig := run.rig_of(trial)) is None:
        return {}
    return {f"trial {trial['number']}, {'without a value' if rig.feasible else 'infeasible'}": rig}


def _picture(run: SearchFolder) -> Section:
    """Draw the vehicle with its LiDARs, for the first screen; no figure without a rig."""
    rigs, best = run.search.rigs, _best(run)
    best_drawn = dict(list(best.items())[:MOST_BEST])
    first = f"{len(best_drawn)} of the front" if len(best) > len(best_drawn) else "the best"
    kinds = {first if run.search.best else "the nearest trial": best_drawn}
    for role, kind in {"greedy": "greedy's", "plain": "plain ones", "paper": "the paper's"}.items():
        kinds[kind] = {name: rig for name, rig in rigs.items() if rig.role == role}
    menu = {name: rig for kind in kinds.values() for name, rig in kind.items()}
    further = [(name, rig) for name, rig in rigs.items() if name not in menu]
    kinds["others"] = dict(further[: max(0, MOST_RIGS - len(menu))])
    menu |= kinds["others"]
    if not menu:
        return Section("The rigs", place="picture")
    named = ", ".join(kind for kind, of_kind in kinds.items() if of_kind)
    pictured = {
        name: PicturedRig.in_zones(rig.placed, rig.models, rig.zones) for name, rig in menu.items()
    }
    pictured = with_grounds_of_folder(pictured, run.path, run.search.classes, run.search.body)
    notes = [
        f"Choose a rig in the menu: {named}. {axes_and_posts(run.search.body)}",
        ground_note(pictured),
    ]
    picture = rig_picture(pictured, run.search.body, run.search.zones)
    return Section("The rigs", [*filter(None, notes)], [picture], place="picture")


def _unseen(run: SearchFolder) -> Section | None:
    before, after = run.search.baseline, run.search.best[0] if run.search.best else None
    if before is None or after is None or before == after:
        return None
    section, rows = Section("What stays unseen"), []
    for name, maps in run.unseen.items():
        if before not in maps or after not in maps:
            continue
        section.figures += of_searches.unseen(
            maps[before], maps[after], run.roi, run.search.body, (name, before, after)
        )
        whole = float(run.pog[name].sum(dtype=float)) if name in run.pog else float("nan")
        left = [float(maps[rig].sum(dtype=float)) for rig in (before, after)]
        change = f"{digits(100 * (left[1] / left[0] - 1), '+.1f')} %" if left[0] else DASH
        shares = [f"{number(v)} ({100 * v / whole:.1f} %)" if whole > 0 else DASH for v in left]
        rows.append((name, number(whole), *shares, change))
    if not rows:
        return None
    section.notes.append(
        "Entropy that no beam reaches, of each column of voxels from above. Both rigs on one "
        "scale; the third map is their difference: blue: the best rig sees more; orange: it "
        "sees less."
    )
    head = ("class", "entropy (nats)", f"unseen by {before}", f"unseen by {after}", "change")
    section.tables.append(Table("Unseen entropy", head, tuple(rows)))
    return section


def _history(run: SearchFolder) -> Section:
    search = run.search
    section = Section("How the search went", [headline.effort(search)], columns=2)
    bound, rays = search.bound, search.strided
    if rays:
        section.notes.append(
            f"All figures here are as searched, with {rays}; the table of rigs is with all rays."
        )
    peers = {name: rig for name, rig in search.rigs.items() if rig.role in ("plain", "paper")}
    kind = "plain rigs" if any(rig.role == "plain" for rig in peers.values()) else "paper"
    for objective in search.objectives:
        values = {name: rig.searched_value(objective) for name, rig in peers.items()}
        with_values = [name for name, value in values.items() if not np.isnan(value)]
        # In the order of exact values, as the baseline is chosen.
        with_values.sort(key=lambda name: -objective.sign * peers[name].value(objective))
        first_bound = bound if objective is search.first else None
        limits = (first_bound.value, first_bound.greedy) if first_bound else (None, None)
        ranked = {name: values[name] for name in with_values}
        plot = of_searches.search_history(run.evaluated, objective, *limits, ranked, kind)
        section.figures.append(plot)
    if run.bound is not None and len(run.bound):
        best = search.rigs[search.best[0]].searched_value(search.first) if search.best else None
        section.figures.append(of_searches.bound_over_seconds(run.bound, search.first, best))
    caption = "Rigs, with all rays" if rays else "Rigs"
    section.tables.append(tables.rig_table(caption, search))
    if run.greedy is not None and len(run.greedy):
        section.tables.append(tables.greedy_table(run.greedy, rays))
    return section


def _pareto(run: SearchFolder) -> Section | None:
    search = run.search
    if len(search.objectives) < 2:
        return None
    if len(search.best) == 1:
        names = " and ".join(objective.name for objective in search.objectives)
        note = f"The front is a single rig, {search.best[0]}: no other is better in {names}."
        return Section("Pareto front", [note])
    notes = [
        f"{headline.of_front(search)}: a rig that is better in one objective is worse in another."
    ]
    if search.strided:
        notes.append(f"All values here are as searched, with {search.strided}.")
    plots = of_searches.pareto_fronts(run.evaluated, search.objectives, search.rigs, search.best)
    return Section("Pareto front", notes, plots, columns=2)


def _requirements(run: SearchFolder) -> Section | None:
    cases, search = run.requirements, run.search
    if cases is None or cases.empty:
        return None
    worst = worst_cases(cases, ["rig"])
    table = verdict_table(worst, ["rig"]).first(MOST_ROWS)
    section = Section(
        "Requirements", [counted(worst), alone(search.body)], tables=[table], folded=True
    )
    mounts = {name: rig.placed for name, rig in search.rigs.items()}
    order = dict.fromkeys([*_best(run), *worst["rig"]])
    draw_verdicts(section, worst, "rig", order, mounts, run.grounds, search.body)
    return section


def _constraints(run: SearchFolder) -> Section | None:
    if not run.search.constraints:
        return None
    notes = [] if run.search.best else infeasible_sentences(run)
    return Section("Constraints", notes, tables=[constraint_table(run)])


def _robustness(run: SearchFolder) -> Section | None:
    rows, search = run.robustness, run.search
    if rows is None or rows.empty:
        return None
    reference = search.baseline or str(rows["rig"].iloc[0])
    note = (
        "The same rigs in other cases: the mean over draws, in percent of the value of "
        f"{reference} as designed; the bar ends at the worst draw."
    )
    section = Section("Robustness", [note], columns=1)
    for objective in search.objectives:
        of_objective = rows[rows["objective"] == objective.name]
        if len(of_objective):
            designed = search.rigs[reference].value(objective)
            plot = of_searches.robustness_figure(of_objective, objective, reference, designed)
            section.figures.append(plot)
    section.tables.append(tables.robustness_table(rows))
    return section


def _chosen(run: SearchFolder) -> Section | None:
    rows, search = run.chosen, run.search
    if rows is None or rows.empty or search.baseline is None:
        return None
    note = (
        "The best rigs of the search and their peers, evaluated again by the generalist on "
        "other traffic, because the best of many trials is also the luckiest. Differences to "
        f"{search.baseline} have 95 % intervals that hold for all pairs of rigs at once, over the "
        "routes and individuals of these frames and, where there are several, over generalists."
    )
    section = Section("On traffic that the search did not see", [note])
    if search.chosen_over:
        section.notes.append(f"Each value is {search.chosen_over}.")
    of_first_objective = headline.of_objective(rows, search.first)
    parts = [
        part for part in (of_first_objective, rows.drop(of_first_objective.index)) if len(part)
    ]
    section.tables += [tables.verified_table(part, search.baseline, search.first) for part in parts]
    return section


def _verified(run: SearchFolder) -> Section | None:
    rows, search = run.verified, run.search
    if rows is None or rows.empty or search.baseline is None:
        return None
    note = (
        f"Differences to {search.baseline} have 95 % intervals that hold for all pairs of rigs at "
        "once, over seeds and, where they are known, over the routes and individuals of the test "
        "frames, as in the report of the sweep."
        if search.baseline in set(rows["rig"])
        else f"No detector evaluated {search.baseline}, the baseline of this comparison: the "
        "vehicle does not carry it, or its trainings failed."
    )
    table = tables.verified_table(rows, search.baseline, search.first)
    return Section("Did the gain become AP?", [note], tables=[table])


def _parameters(run: SearchFolder) -> Section | None:
    shares = run.search.importance
    if not shares:
        return None
    largest = sorted(shares.items(), key=lambda item: -item[1])[:5]
    parts = ", ".join(f"{name} {100 * share:.0f} %" for name, share in largest)
    notes = [
        f"Most important for reaching good values of {run.search.first.name} (shares by "
        f"PED-ANOVA): {parts}.",
        "optuna-dashboard, with the command below, plots values by parameter; MLflow has a run a "
        "trial, and trials.parquet a row.",
    ]
    return Section("Important parameters", notes=notes)
