"""The rigs of a configuration, each built once."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cache

from lidarplace.base.errors import InputError, at
from lidarplace.base.suggestions import did_you_mean
from lidarplace.configuration.placement import SweptPlacementSettings
from lidarplace.configuration.sensor import Losses
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import PAPER_PLACEMENTS, Placement
from lidarplace.rigs.weather import Weather
from lidarplace.scenes.kinds import Scene
from lidarplace.scenes.recorded import LogScene
from sweeps.configuration.point import LidarSettings, Point


class Rigs:
    """Own placements and the paper's by name, with the LiDARs and in the weather of points.

    The same rig is always the same object."""

    def __init__(
        self,
        settings: Mapping[str, SweptPlacementSettings],
        first: Point,
        built: Mapping[str, Placement] | None = None,
    ) -> None:
        """Build own placements as the first point has them; `built` are the same for all points.

        Raises ValueError, as `of` does."""
        check_names(settings)
        self.own, self._ready = settings, built or {}
        self._built = cache(self._build)
        self._in_weather = cache(Lidar.in_weather)
        self._subset = cache(_subset)
        with at(key="placements"):
            for name in settings:
                self.of(first, name)

    def of(self, point: Point, name: str | None = None) -> Placement:
        """Return the rig of a point, or the one called `name` with its LiDARs and in its weather.

        Raises ValueError: there is none of that name, two of its LiDARs have one position, the
        weather does not fit them, or LiDARs of a recorded rig are not those of the point's
        scene."""
        name, subset = name or point.placement, None
        if name in self._ready:
            return self._ready[name]
        if names := self.recorded(name):
            with at(key=f"{name}.recorded"):
                subset = self._subset(point.scene, point.lidar, names)
        lidar, losses = point.lidar.lidar(), point.lidar.losses
        return self._built(name, lidar, losses, point.weather.weather(), subset)

    def recorded(self, name: str) -> tuple[str, ...]:
        """Return the LiDARs of the recorded rig that a placement names; none by coordinates."""
        return self.own[name].recorded if name in self.own else ()

    def _build(
        self, name: str, lidar: Lidar, losses: Losses, weather: Weather, subset: Placement | None
    ) -> Placement:
        lidar = self._in_weather(lidar, weather)
        if subset is not None:
            rig = replace(subset, name=name)
        elif name in self.own:
            rig = self.own[name].placement(name, lidar, losses)
        elif name in PAPER_PLACEMENTS:
            rig = PAPER_PLACEMENTS[name].with_lidar(lidar)
        else:
            names = [*PAPER_PLACEMENTS, *self.own, *self._ready]
            hint = did_you_mean(name, names)
            raise InputError(f"no placement {name!r}{hint}", expected=f"one of {', '.join(names)}")
        return rig.each_lidar(lambda model: self._in_weather(model, weather))


def check_names(names: Iterable[str]) -> None:
    """Raise InputError if an own placement has the name of one of the paper's."""
    for name in sorted(set(names) & set(PAPER_PLACEMENTS)):
        raise InputError(f"{name!r} is the paper's", key="placements", fix="choose another name")


def _subset(scene: Scene, lidar: LidarSettings, names: tuple[str, ...]) -> Placement:
    """Return LiDARs of the rig that recorded a log, corrected by `lidar`. Raises ValueError."""
    if not isinstance(scene, LogScene):
        problem, expected = "needs the recorded rig of a log", "scene.source log"
        raise InputError(problem, expected=expected, found=scene.source)
    subset = scene.rig.subset(names)
    models = zip(subset.names, subset.placement.lidars, strict=True)
    return replace(subset.placement, lidar=[lidar.corrected(model, name) for name, model in models])
