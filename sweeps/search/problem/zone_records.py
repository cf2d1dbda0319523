"""Zones of a search as `search.json` has them."""

from sweeps.search.problem.space import Space
from tracking.run_folders import search_json


def zones_of(space: Space) -> list[search_json.Zone]:
    """Describe the zones of a search with their ranges of angles, also by model."""

    def angles(zone: str, model: str = "") -> dict[str, tuple[float, float]]:
        return {f"{angle}_deg": span for angle, span in space.spans(zone, model).items()}

    zones = []
    for zone in space.zones:
        settings, spans = space.settings.zones[zone.name], angles(zone.name)
        models = {m: search_json.Angles(**angles(zone.name, m)) for m in settings.models or ()}
        pairs = settings.mirrored or space.settings.symmetric
        shape = {"name": zone.name, "polygon": zone.polygon, "z": zone.z}
        zones.append(search_json.Zone(**shape, **spans, models=models, mirrored=pairs))
    return zones
