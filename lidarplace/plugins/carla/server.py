"""A running CARLA server: connect, load a town, step it, and leave it as it was found."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from lidarplace.base.errors import InputError
from lidarplace.plugins.carla.settings import CarlaScene
from lidarplace.scenes.routes import STEP_S

if TYPE_CHECKING:
    import carla

# CARLA's names of what a parked car may be, old and new.
_PARKED = ("Vehicles", "Car", "Truck", "Bus", "Motorcycle", "Bicycle")


def connect(scene: CarlaScene) -> carla.Client:
    """Connect a client to the scene's server; raise ImportError, and as `check_versions`."""
    try:
        import carla
    except ImportError as error:
        raise ImportError(
            "CARLA's client is missing: pip install carla==<version of the server>"
        ) from error
    client = carla.Client(scene.host, scene.port)
    client.set_timeout(scene.timeout_s)
    check_versions(client, scene)
    return client


def check_versions(client: carla.Client, scene: CarlaScene) -> None:
    """Raise ConnectionError without a server, ValueError unless its version is the client's."""
    try:
        theirs = client.get_server_version()
    except RuntimeError as error:
        raise ConnectionError(
            f"no CARLA server answers at {scene.host}:{scene.port} within {scene.timeout_s:g} s; "
            "start one, or name its host and port"
        ) from error
    ours = client.get_client_version()
    if _release(ours) != _release(theirs):
        raise InputError(
            "client and server have different versions",
            place=f"CARLA server at {scene.host}:{scene.port}", expected=ours, found=theirs,
            fix=f"pip install carla=={_release(theirs)}, or the wheel in PythonAPI/carla/dist of "
            "the server's release",
        )  # fmt: skip


def _release(version: str) -> str:
    """Return the first three numbers: builds such as 0.9.15-dirty or 0.9.10.1 speak as these."""
    release = re.match(r"\d+\.\d+\.\d+", version)
    return release.group() if release else version


def load_town(client: carla.Client, town: str) -> carla.World:
    """Load a map anew and take its parked cars away: they are no actors, so they have no boxes.

    Servers before 0.9.11 cannot take them away. Raises ValueError: the server has no such map."""
    import carla

    maps = sorted(path.rsplit("/", 1)[-1] for path in client.get_available_maps())
    if town not in maps:
        fix = "further towns are in CARLA's package AdditionalMaps"
        names = ", ".join(maps)
        raise InputError(place="CARLA server", key="map", expected=names, found=town, fix=fix)
    world = client.load_world(town)
    if hasattr(world, "enable_environment_objects"):
        kinds = carla.CityObjectLabel
        labels = [getattr(kinds, name) for name in _PARKED if hasattr(kinds, name)]
        parked = {item.id for label in labels for item in world.get_environment_objects(label)}
        world.enable_environment_objects(parked, False)
    return world


@contextmanager
def synchronous(world: carla.World) -> Iterator[None]:
    """Let the world wait for `tick`, each one step of 20 Hz; restore the settings at the end."""
    before, stepped = world.get_settings(), world.get_settings()
    stepped.synchronous_mode = True
    stepped.fixed_delta_seconds = STEP_S
    world.apply_settings(stepped)
    try:
        yield
    finally:
        with suppress(RuntimeError):  # a server that is gone has no settings
            world.apply_settings(before)


class Actors:
    """Actors that this program has put into the world, so that it can take them out."""

    def __init__(self, client: carla.Client, world: carla.World) -> None:
        self._client, self._world = client, world
        self._own: list[carla.Actor] = []

    def spawn(
        self,
        blueprint: carla.ActorBlueprint,
        transform: carla.Transform,
        parent: carla.Actor | None = None,
    ) -> carla.Actor | None:
        """Spawn an actor; return None where there is no room for it."""
        actor = self._world.try_spawn_actor(blueprint, transform, attach_to=parent)
        if actor is not None:
            self._own.append(actor)
        return actor

    def remove(self, actor: carla.Actor) -> None:
        """Take one actor out of the world."""
        self._own.remove(actor)
        actor.destroy()

    def close(self) -> None:
        """Take all actors out of the world, those on others first."""
        import carla

        for actor in self._own:
            if actor.type_id.startswith(("sensor.", "controller.")):
                with suppress(RuntimeError):  # it is gone already
                    actor.stop()
        with suppress(RuntimeError):  # a server that is gone has no actors
            self._client.apply_batch_sync(
                [carla.command.DestroyActor(actor.id) for actor in reversed(self._own)]
            )
        self._own.clear()
