"""Collect box logs and clouds from CARLA."""

from pathlib import Path
from typing import Annotated, Self

import typer
from pydantic import BeforeValidator, ValidationError, model_validator

from lidarplace.base.errors import InputError
from lidarplace.base.ranges import PORT, TIMEOUT
from lidarplace.command_line.terminal import say
from lidarplace.command_line.verbs import new_app, verb, within, wrong
from lidarplace.configuration.placement import PlacementSettings
from lidarplace.configuration.settings import Name, Settings, fault
from lidarplace.configuration.yaml import read_yaml_file
from lidarplace.plugins.carla.collect import collect
from lidarplace.plugins.carla.settings import CarlaScene
from lidarplace.rig_files.carla import check_possible
from lidarplace.rigs.lidar import Lidar
from lidarplace.rigs.placement import PAPER_PLACEMENTS, Placement

app = new_app()


def _named(lidar: object) -> object:
    return Lidar.named(lidar) if isinstance(lidar, str) else lidar


class Collection(Settings):
    """Settings file of a collection."""

    scene: CarlaScene = CarlaScene()
    lidar: Annotated[Lidar, BeforeValidator(_named)] | None = None
    """LiDAR of every placement: its name in the catalogue, or lengths in metres and angles in
    radians; null is the paper's."""
    placements: dict[Name, PlacementSettings | None] = dict.fromkeys(PAPER_PLACEMENTS)
    """Placements by name, as in a sweep; without mounts, a name is one of the paper's eight."""

    @model_validator(mode="after")
    def _possible(self) -> Self:
        self.rigs()
        return self

    def rigs(self) -> dict[str, Placement]:
        """Build the placements.

        Raises ValueError for a name without mounts that is not the paper's, and for LiDARs with
        what none of CARLA's has."""
        lidar = self.lidar or Lidar.paper()
        rigs = {}
        for name, settings in self.placements.items():
            if settings is not None:
                rigs[name] = settings.placement(name, lidar)
            elif name in PAPER_PLACEMENTS:
                rigs[name] = PAPER_PLACEMENTS[name].with_lidar(lidar)
            else:
                expected = f"mounts, which only {', '.join(PAPER_PLACEMENTS)} may lack"
                raise InputError(key=f"placements.{name}", expected=expected, found="none")
            for model in rigs[name].lidars:
                check_possible(model, f"placements: {name}")
        return rigs


@verb(app, "town.yaml logs/carla --host localhost")
def carla(
    config: Annotated[Path, typer.Argument(help="YAML file of scene, placements, lidar")],
    out: Annotated[Path, typer.Argument(help="folder of the box log and the clouds")],
    host: Annotated[
        str | None, typer.Option(help="address of the server; overrides the file")
    ] = None,
    port: Annotated[
        int | None,
        typer.Option(help="port of the server; overrides the file", callback=within(PORT)),
    ] = None,
    timeout: Annotated[
        float | None, typer.Option(help="seconds; overrides the file", callback=within(TIMEOUT))
    ] = None,
) -> None:
    """Collect a box log, and the clouds of placements, from a running CARLA server.

    Existing results in OUT are kept. An unreachable server is an invalid input."""
    try:
        content = read_yaml_file(config) or {}
        options = {"host": host, "port": port, "timeout_s": timeout}
        if isinstance(content, dict) and isinstance(content.get("scene", {}), dict):
            named = {key: value for key, value in options.items() if value is not None}
            content = content | {"scene": content.get("scene", {}) | named}
        collection = Collection.model_validate(content)
        collect(collection.scene, collection.rigs(), out, report=say)
    except ValidationError as error:
        wrong(fault(error, str(config)))
    except (ValueError, OSError, RuntimeError, ImportError) as error:
        wrong(error)
