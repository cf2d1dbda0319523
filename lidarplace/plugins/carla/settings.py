"""Settings of a scene that a CARLA server simulates, and the routes that it consists of."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field, field_validator

from lidarplace.base.errors import InputError
from lidarplace.clouds.clouds import Crop
from lidarplace.configuration.settings import (
    ClassName,
    Count,
    CountFromOne,
    Length,
    Seconds,
    Seed,
    Text,
)
from lidarplace.scenes.routes import Part, RouteSettings, seed_of

PAPER_TOWNS = ("Town01", "Town03", "Town04", "Town06")


@dataclass(frozen=True)
class Route:
    """One drive of the ego, with traffic of its own."""

    number: int  # in the whole log
    name: str  # of its folders
    town: str  # CARLA's map
    part: Part
    start: int  # which of the town's starts it takes; no two routes of a town have the same
    first_frame: int  # number of its first frame in the log
    seed: int  # of its traffic, 31 bits


class CarlaScene(RouteSettings):
    """Towns, their traffic, and which drives through them are recorded.

    The ego is driven by CARLA's traffic manager from starts that lie far apart. Every route has
    traffic of its own. A town is the same place in training and testing, unless `test_towns` names
    others."""

    source: Literal["carla"] = Field("carla", description="scene type")
    host: Text = Field("localhost", description="where the server runs")
    port: Annotated[CountFromOne, Field(le=65534)] = Field(
        default=2000, description="its first port; it also uses the next one"
    )
    traffic_manager_port: Annotated[CountFromOne, Field(le=65535)] = Field(
        default=8000, description="where the client opens the traffic manager"
    )
    timeout_s: Seconds = Field(
        default=60.0,
        gt=0.0,
        description="longest wait for an answer, seconds; loading a town takes the longest",
    )
    seed: Seed = Field(default=0, description="decides starts, traffic and dropped returns")
    towns: tuple[Text, ...] = Field(
        default=PAPER_TOWNS, min_length=1, description="CARLA's maps of the training routes"
    )
    test_towns: tuple[Text, ...] | None = Field(
        default=None,
        min_length=1,
        description="CARLA's maps of the test routes; the same towns with other starts if null",
    )
    density: CountFromOne = Field(
        default=80,
        description="vehicles in each town, including the ego; the paper's are 40, 80 and 120",
    )
    pedestrians: Count = Field(default=60, description="pedestrians in each town")
    routes: CountFromOne = Field(default=8, description="routes in each training town")
    test_routes: Count = Field(default=2, description="routes in each test town")
    ego: Text = Field(
        "vehicle.tesla.model3", description="blueprint of the vehicle that carries the LiDARs"
    )
    crop: tuple[Length, Length, Length, Length, Length, Length] = Field(
        (-50.0, -50.0, -3.0, 50.0, 50.0, 5.0),
        description="x0, y0, z0, x1, y1, z1 in the ego frame, metres; points outside are left out",
    )
    classes: dict[str, ClassName] = Field(
        {}, description="blueprint -> class, such as Truck, before the built-in rules"
    )

    @field_validator("crop")
    @classmethod
    def _not_empty(cls, crop: Crop) -> Crop:
        if not all(low < high for low, high in zip(crop[:3], crop[3:], strict=True)):
            raise InputError(expected="x0 < x1, y0 < y1, z0 < z1")
        return crop

    def plan(self) -> tuple[Route, ...]:
        """List the routes of the scene, training first; each can be recorded on its own."""
        tests = self.towns if self.test_towns is None else self.test_towns
        places: list[tuple[Part, str]] = [
            *(("train", town) for town in self.towns for _ in range(self.routes)),
            *(("test", town) for town in tests for _ in range(self.test_routes)),
        ]
        routes = []
        for number, (part, town) in enumerate(places):
            start = [before for _, before in places[:number]].count(town)
            seed, first = seed_of(self.seed, 1, number), number * self.frames_per_route
            routes.append(Route(number, f"route-{number:03d}", town, part, start, first, seed))
        return tuple(routes)
