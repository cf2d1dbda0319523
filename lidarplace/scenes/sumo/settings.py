"""Settings of a simulated traffic scene, and the simulations that it consists of."""

import re
from collections import Counter
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from lidarplace.base.errors import InputError
from lidarplace.configuration.settings import Count, CountFromOne, Seed, Text
from lidarplace.scenes.routes import STEP_S, TEST_EVERY, Part, RouteSettings, seed_of
from lidarplace.scenes.site import Site

GENERATED = "generated"
MAP_SUFFIXES = (".net.xml", ".xodr", ".xodr.gz")


def _town(name: str) -> str:
    if name.endswith(MAP_SUFFIXES) or re.fullmatch(r"\w+", name):
        return name
    expected = f"'{GENERATED}', a path that ends in {', '.join(MAP_SUFFIXES)}, or the name of a "
    raise InputError(expected=f"{expected}CARLA map such as Town03")


Town = Annotated[Text, AfterValidator(_town)]


class TownRun(BaseModel):
    """One simulation of a scene, in one town, from which one or several egos are recorded."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str  # `scene` of its boxes; its poses and buildings share a world frame
    town: str  # as in `SumoScene.towns`
    part: Part  # whether its routes are for training or for testing
    first_route: int  # its number in the log
    first_frame: int  # likewise
    routes: int  # egos to record
    town_seed: int  # decides a generated town, and where the buildings stand
    traffic_seed: int  # decides who drives where
    site: Site | None = Field(None, exclude_if=lambda site: site is None)  # in place of egos


class SumoScene(RouteSettings):
    """Towns, their traffic, and which drives through them are recorded.

    Training and test routes never share traffic. A generated town is another one for testing; a
    map is the same place in both, its buildings included, unless `test_towns` names others."""

    source: Literal["sumo"] = Field("sumo", description="scene type: simulated traffic")
    seed: Seed = Field(
        default=0,
        description="decides generated towns, buildings, traffic and sizes; the same seed gives "
        "the same log to the byte",
    )
    towns: tuple[Town, ...] = Field(
        default=(GENERATED,),
        min_length=1,
        description="towns of the training routes: generated, a path to a SUMO network (.net.xml) "
        "or to OpenDRIVE (.xodr, .xodr.gz), or the name of a CARLA map such as Town03",
    )
    test_towns: tuple[Town, ...] | None = Field(
        default=None,
        min_length=1,
        description="towns of the test routes; those of towns if null, with newly generated ones",
    )
    test_seed: Seed | None = Field(
        default=None,
        description="decides towns and traffic of the test routes only; seed decides if null. "
        "Trainings do not depend on it",
    )
    density: CountFromOne = Field(
        default=80, description="vehicles in each town; the paper's are 40, 80 and 120"
    )
    pedestrians: Count = Field(default=60, description="pedestrians in each town")
    buildings: bool = Field(True, description="whether there are buildings along the roads")
    routes: CountFromOne = Field(default=8, description="egos recorded in each training town")
    test_routes: Count = Field(default=4, description="egos recorded in each test town")
    egos_per_run: CountFromOne | None = Field(
        default=None,
        description="egos recorded from one simulation of a town; all of them if null. Fewer "
        "are more diverse, and simulations can run in parallel",
    )

    def town_runs(self, site: Site | None = None) -> tuple[TownRun, ...]:
        """List the simulations of the scene, training first; each can be recorded on its own.

        Routes and frames are numbered through the whole scene, before anything is recorded. At a
        site every route has its own traffic in one town. Raises ValueError: there are several,
        frames are kept by travel, or the site has keys of logs."""
        if site is not None:
            self._check(site)
        tests = self.towns if self.test_towns is None else self.test_towns
        places: list[tuple[Part, str, int]] = [
            *(("train", town, self.routes) for town in self.towns),
            *(("test", town, self.test_routes) for town in tests),
        ]
        runs: list[TownRun] = []
        names: Counter[str] = Counter()
        route = 0
        for number, (part, town, routes) in enumerate(places):
            other = self.test_seed if part == "test" else None
            seed = self.seed if other is None else other
            tag = str(self.seed) if other is None else f"{self.seed}.{other}"
            name = f"sumo-{tag}-{part}-{Path(town).name.split('.')[0]}"
            # A map is the same place in training and testing, and with any seed of a test.
            anew = town == GENERATED and site is None
            place = (seed, 0, number) if anew else (self.seed, 0, 0)
            most = (self.egos_per_run or routes) if site is None else 1
            for first in range(0, routes, max(most, 1)):
                names[name] += 1
                count = min(most, routes - first)
                run = TownRun(
                    # No town's own name has a slash.
                    name=name if names[name] == 1 else f"{name}/{names[name]}",
                    town=town,
                    part=part,
                    first_route=route,
                    first_frame=route * self.frames_per_route,
                    routes=count,
                    town_seed=seed_of(*place),
                    traffic_seed=seed_of(seed, 1, len(runs)),
                    site=site,
                )
                runs.append(run)
                route += count
        return tuple(runs)

    def _check(self, site: Site) -> None:
        for key in ("scene", "within"):
            if getattr(site, key) != Site.model_fields[key].default:
                fix = "remove it"
                raise InputError("only a site in a log has it", key=f"site.{key}", fix=fix)
        towns = {*self.towns, *(self.test_towns or ())}
        if len(towns) > 1:
            names = ", ".join(sorted(towns))
            raise InputError(
                "a site is in one town", key="scene.towns", expected="one", found=names
            )
        if self.min_travel_m:
            travel = f"{self.min_travel_m:g}"
            raise InputError(
                "a site does not move", key="scene.min_travel_m", expected=0, found=travel
            )

    def frame_counts(self) -> tuple[int, int]:
        """Count training and test frames; upper bounds with `min_travel_m`."""
        runs = self.town_runs()
        train, test = (sum(r.routes for r in runs if r.part == p) for p in ("train", "test"))
        if self.split == "route":
            return train * self.frames_per_route, test * self.frames_per_route
        tenth = self.frames_per_route // TEST_EVERY
        return (train + test) * (self.frames_per_route - tenth), (train + test) * tenth

    @property
    def name(self) -> str:
        """The scene's name in labels, where nothing else distinguishes it from others."""
        return f"sumo-{self.seed}"

    def remedy(self, split: str) -> str:
        """Say what to change if there is no frame of a split."""
        if self.split == "route":
            return f"test_routes is {self.test_routes}, allowed is at least 1"
        why = "'split: paper' takes every tenth frame of a route, so allowed is at least 10"
        return f"frames_per_route is {self.frames_per_route}, and {why}"

    @property
    def seconds(self) -> float:
        """Simulated time of one run, warm-up included."""
        return (self.warmup_steps + self.frames_per_route * self.frame_stride) * STEP_S
