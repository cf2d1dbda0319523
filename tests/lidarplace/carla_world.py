"""A CARLA server in memory: the calls that a collection makes, and a world simple enough to check.

Poses and boxes are CARLA's own classes. Vehicles drive straight ahead on a plane that rises along
x, walkers walk straight on; LiDARs are cast here, in CARLA's left-handed frames, ray by ray against
the plane and the boxes, with nothing of `lidarplace`.
"""

from fnmatch import fnmatch
from types import SimpleNamespace
from unittest.mock import Mock

import carla
import numpy as np

SLOPE_DEG = 4.0
"""The plane rises so steeply along x: whoever drives towards +x has the nose up."""

# Half sizes, and how far the middle of the box lies ahead of the actor's origin.
MODELS = {
    "vehicle.tesla.model3": (2.4, 1.1, 0.75, 0.05),
    "vehicle.audi.tt": (2.1, 1.0, 0.69, -0.02),
    "vehicle.carlamotors.carlacola": (2.6, 1.3, 1.24, 0.1),
    "vehicle.bh.crossbike": (0.75, 0.43, 0.8, 0.0),
}
WALKERS = {"walker.pedestrian.0001": (0.19, 0.19, 0.93, 0.0)}
LIDAR_ATTRIBUTES = (
    *("channels", "range", "points_per_second", "rotation_frequency", "upper_fov", "lower_fov"),
    *("dropoff_general_rate", "dropoff_intensity_limit", "dropoff_zero_intensity"),
    *("atmosphere_attenuation_rate", "noise_stddev", "sensor_tick", "role_name"),
)
SPEED_M_S = 8.0
STEP_S = 0.05


def height(x):
    return float(np.tan(np.radians(SLOPE_DEG)) * x)


class Blueprint:
    def __init__(self, name, **attributes):
        self.id = name
        self.attributes = dict(attributes)

    def has_attribute(self, name):
        return name in self.attributes

    def set_attribute(self, name, value):
        if name not in self.attributes:
            raise IndexError(f"{self.id} has no attribute {name}")
        assert isinstance(value, str)
        self.attributes[name] = value


class Library:
    def __init__(self, server):
        wheels = {n: "2" if n.endswith("bike") else "4" for n in server.models}
        self._blueprints = {
            **{n: {"number_of_wheels": number} for n, number in wheels.items()},
            **{n: {} for n in WALKERS},
            "controller.ai.walker": {},
            "sensor.lidar.ray_cast": dict.fromkeys(LIDAR_ATTRIBUTES, "0"),
        }

    def filter(self, pattern):
        return [self.find(name) for name in self._blueprints if fnmatch(name, pattern)]

    def find(self, name):
        return Blueprint(name, **self._blueprints[name])


class Actor:
    def __init__(self, world, number, blueprint, transform, parent):
        self._world, self._parent = world, parent
        self.id, self.type_id = number, blueprint.id
        self.attributes = dict(blueprint.attributes)
        self.is_alive, self.physics, self.autopilot = True, True, False
        self.goal = self.callback = None
        self._transform = transform
        half = (world.server.models | WALKERS).get(blueprint.id)
        if half:
            # A vehicle stands on its origin, a walker's origin is its middle.
            z = half[2] if blueprint.id.startswith("vehicle.") else 0.0
            middle = carla.Location(half[3], 0, z)
            self.bounding_box = carla.BoundingBox(middle, carla.Vector3D(*half[:3]))

    @property
    def matrix(self):
        own = np.array(self._transform.get_matrix())
        return own if self._parent is None else self._parent.matrix @ own

    def get_transform(self):
        if not self.is_alive:
            raise RuntimeError("trying to operate on a destroyed actor")
        return self._transform

    def set_transform(self, transform):
        self._transform = transform

    def set_simulate_physics(self, enabled):
        self.physics = enabled

    def set_autopilot(self, enabled, port):
        assert port == self._world.server.traffic_manager.get_port()
        self.autopilot = enabled

    def listen(self, callback):
        self.callback = callback

    def start(self):
        pass

    def go_to_location(self, location):
        self._parent.goal = location

    def set_max_speed(self, speed):
        self._parent.speed = speed

    def stop(self):
        self.callback = None

    def destroy(self):
        self.is_alive = False
        del self._world.actors[self.id]

    def step(self):
        place, turn = self._transform.location, self._transform.rotation
        ground = height(place.x)
        if self.autopilot:
            ahead = self._transform.get_forward_vector()
            step = SPEED_M_S * STEP_S
            place = place + carla.Location(ahead.x * step, ahead.y * step, 0)
            place.z = height(place.x)
        elif self.goal is not None:
            way = self.goal - place
            share = self.speed * STEP_S / max(np.hypot(way.x, way.y), 1e-6)
            place = place + carla.Location(way.x * share, way.y * share, 0)
            place.z = height(place.x) + WALKERS[self.type_id][2]
        elif self.physics and place.z > ground + 2:
            place = carla.Location(place.x, place.y, place.z - 0.5)  # falls
        self._transform = carla.Transform(place, turn)


class World:
    def __init__(self, server, town):
        self.server, self.town = server, town
        self.actors, self.frame, self._next = {}, 100, 1
        self.settings = carla.WorldSettings()
        self.rng = np.random.default_rng(0)
        self.hidden = set()

    def get_settings(self):
        copy = carla.WorldSettings()
        copy.synchronous_mode = self.settings.synchronous_mode
        copy.fixed_delta_seconds = self.settings.fixed_delta_seconds
        return copy

    def apply_settings(self, settings):
        self.settings = settings

    def get_environment_objects(self, label):
        return [SimpleNamespace(id=7)] if label == carla.CityObjectLabel.Car else []

    def enable_environment_objects(self, objects, enable):
        assert not enable
        self.hidden |= objects

    def get_blueprint_library(self):
        return Library(self.server)

    def get_map(self):
        return SimpleNamespace(get_spawn_points=self._starts)

    def _starts(self):
        points = []
        for lane, (y, yaw) in enumerate(((-5.5, 0), (-2, 0), (2, 180), (5.5, 180))):
            for k in range(6):
                x = 12.0 * k + 3 * lane
                turn = carla.Rotation(pitch=SLOPE_DEG if yaw == 0 else -SLOPE_DEG, yaw=yaw)
                points.append(carla.Transform(carla.Location(x, y, height(x)), turn))
        return points

    def get_random_location_from_navigation(self):
        x, y = self.rng.uniform(0, 70), self.rng.choice([-9.0, 9.0])
        return carla.Location(x, y, height(x) + WALKERS["walker.pedestrian.0001"][2])

    def set_pedestrians_seed(self, seed):
        self.rng = np.random.default_rng(seed)

    def try_spawn_actor(self, blueprint, transform, attach_to=None):
        others = [actor.get_transform().location for actor in self._all() if not actor._parent]
        if attach_to is None and any(own.distance(transform.location) < 1 for own in others):
            return None
        actor = Actor(self, self._next, blueprint, transform, attach_to)
        self.actors[self._next] = actor
        self._next += 1
        sensors = sum(a.type_id.startswith("sensor.") for a in self._all())
        self.server.most_sensors = max(self.server.most_sensors, sensors)
        return actor

    def _all(self):
        return list(self.actors.values())

    def tick(self, seconds=0.0):
        assert self.settings.synchronous_mode
        assert self.settings.fixed_delta_seconds == STEP_S
        self.frame += 1
        self.server.ticks += 1
        if self.server.ticks == self.server.dies_at:
            raise RuntimeError("time-out while waiting for the simulator")
        if self.server.ticks == self.server.vanish[0]:
            self.actors[self.server.vanish[1]].destroy()
        for actor in self._all():
            if actor._parent is None:
                actor.step()
        if self.server.shove and any(a.callback for a in self._all()):
            self._all()[1].get_transform().location.x += self.server.shove
        for actor in self._all():
            if actor.callback and actor.id != self.server.mute:
                boxes = [a for a in self._all() if hasattr(a, "bounding_box")]
                solid = [a for a in boxes if not fnmatch(a.type_id, self.server.glass)]
                points = cast(actor, solid)
                for frame in (self.frame - 1, self.frame):  # the old one must be dropped
                    data = points if frame == self.frame else points[:1]
                    actor.callback(SimpleNamespace(frame=frame, raw_data=data.tobytes()))
        return self.frame


class Server:
    """What `carla.Client` is to a collection; `worlds` are those that it loaded.

    What can go wrong: it dies at tick `dies_at`, sensor `mute` is silent, somebody is shoved by
    `shove` metres in a replay, rays pass through models like `glass`, and at tick `vanish[0]` actor
    `vanish[1]` disappears.
    """

    version, models = "0.9.16", MODELS
    dies_at, mute, shove, glass, vanish = -1, None, 0.0, "", (-1, 0)

    def __init__(self, **changes):
        self.__dict__.update(changes)
        self.ticks = self.most_sensors = 0
        self.worlds, self.traffic_manager = [], Mock()
        self.traffic_manager.get_port.return_value = 8000

    def get_client_version(self):
        return "0.9.16"

    def get_server_version(self):
        return self.version

    def get_available_maps(self):
        return [f"/Game/Carla/Maps/{name}" for name in ("Town01", "Town03")]

    def load_world(self, town):
        self.worlds.append(World(self, town))
        return self.worlds[-1]

    def get_trafficmanager(self, port):
        assert port == 8000
        return self.traffic_manager

    def apply_batch_sync(self, commands):
        actors = self.worlds[-1].actors
        for command in commands:
            if command.actor_id not in actors:
                continue  # CARLA's answer would name the error
            if isinstance(command, carla.command.DestroyActor):
                actors[command.actor_id].destroy()
            else:
                actors[command.actor_id].set_transform(command.transform)


def cast(sensor, actors):
    """Returns of one turn, in the sensor's left-handed frame, as CARLA orders and computes them."""
    read = {name: float(value) for name, value in sensor.attributes.items() if name != "role_name"}
    channels = int(read["channels"])
    steps = round(read["points_per_second"] * STEP_S / channels)
    elevation = np.radians(np.linspace(read["upper_fov"], read["lower_fov"], channels))[:, None]
    turn = read["rotation_frequency"] * STEP_S * 2 * np.pi
    azimuth = -np.pi + turn * np.arange(steps) / steps
    level = np.cos(elevation)
    axes = level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)
    rays = np.stack(np.broadcast_arrays(*axes), axis=-1).reshape(-1, 3)
    pose = sensor.matrix
    origin, world = pose[:3, 3], rays @ pose[:3, :3].T
    normal = np.array([-np.tan(np.radians(SLOPE_DEG)), 0, 1])
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = -(origin @ normal) / (world @ normal)
        distance[distance < 0] = np.inf
        for actor in actors:
            into = np.linalg.inv(actor.matrix)
            box = actor.bounding_box
            half = np.array([box.extent.x, box.extent.y, box.extent.z])
            start = into[:3, :3] @ origin + into[:3, 3]
            start -= [box.location.x, box.location.y, box.location.z]
            toward = world @ into[:3, :3].T
            sides = np.sort(np.stack([(-half - start) / toward, (half - start) / toward]), axis=0)
            enter, leave = sides[0].max(axis=1), sides[1].min(axis=1)
            hit = (enter <= leave) & (enter >= 0)
            distance[hit] = np.minimum(distance, enter)[hit]
    seen = distance <= read["range"]
    distance = distance[seen]
    points = np.column_stack([rays[seen] * distance[:, None], np.exp(-0.004 * distance)])
    return points.astype(np.float32)
