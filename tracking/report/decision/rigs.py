"""The section of the rigs on the vehicle."""

from collections.abc import Sequence

from lidarplace.rigs.placement import Mount
from tracking.figures.kit.style import text
from tracking.figures.kit.vehicle_lines import name_of
from tracking.figures.of_sweeps.rig_views import ViewedRig, rig_views
from tracking.numbers import digits
from tracking.pages.section import Section
from tracking.report.decision.recommendation import Recommendation
from tracking.run_folders.sweep import RunFolder
from tracking.run_folders.sweep_json import LidarModel


def rigs_section(run: RunFolder, found: Recommendation) -> Section:
    """The best rigs side by side, from above and from the side, with mounts and models."""
    section = Section("Where the LiDARs sit")
    section.notes.append(
        f"From above, and from the side; the nose of {name_of(run.sweep.body)} is on the right. A "
        "line leads from above to where a LiDAR's top leans, from the side to where its front "
        "points. x is forward, y to the left, z above the ground."
    )
    left = len(found.best.sure) - len(found.shown)
    if left:
        more = f"{left} more {'is' if left == 1 else 'are'} in the report"
        section.notes.append(f"Drawn are the {len(found.shown)} best, {more}.")
    lidars = run.sweep.lidars
    section.figures = rig_views(
        [
            viewed_rig(name, run.placements[name], lidars.get(name, ()), found.best.equal == [name])
            for name in found.shown
        ],
        run.sweep.body,
    )
    return section


def viewed_rig(
    name: str, mounts: Sequence[Mount], models: Sequence[LidarModel], best: bool = False
) -> ViewedRig:
    """A rig to be drawn, with what is told of its LiDARs.

    Args:
        models: of every mount; none if they are not known.
        best: whether it alone has the highest mean.
    """
    words = [model_words(model) for model in models]
    same = len(set(words)) == 1
    said = f"{len(mounts)} LiDAR{'s' * (len(mounts) != 1)}" + (f" · {words[0]}" if same else "")
    said += _price(models)
    mark = " · highest mean" if best else ""
    return ViewedRig(
        tuple(mounts),
        f"<b>{text(name)}</b>{mark}<br><span style='font-size:12px'>{said}</span>",
        tuple(words) if words and not same else ("",) * len(mounts),
    )


def _price(models: Sequence[LidarModel]) -> str:
    """Of all LiDARs; "" unless that of each is known."""
    prices = [model.price_usd for model in models if model.price_usd is not None]
    return f" · {sum(prices):,.0f} US$" if models and len(prices) == len(models) else ""


def model_words(model: LidarModel) -> str:
    """A LiDAR model in a few words."""
    low, high = (f"{digits(angle, 'z.3g')}°" for angle in model.elevation_deg)
    kind = "beams" if model.azimuth_steps > 1 else "rays of a pattern"
    beams = f"{model.beams:,} {kind}, {low} to {high}"
    return f"{text(model.name)}, {beams}" if model.name else beams
