"""Shapes of objects: a few convex parts inside each box.

A part is an upright box whose top may be shorter and narrower than its bottom, so that a cabin has
a sloped windscreen. The parts of an object never leave its box, which is a label: the surfaces of
vehicles are `MARGIN_M` inside of it. Proportions and materials are drawn from a hash of seed and
object id: an object looks the same in every frame and under every placement."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.clouds.reflectivity import Material, reflectivity, uniforms
from lidarplace.logs.boxes import GEOMETRY

BUILDING, SIGN, WORLD, BODY = -2, -3, -4, -5
"""Owners of parts that belong to no object: a building, a sign, what stands still in a recorded
log, and the vehicle's own body."""
PANE = -10
"""Owner of the windows of object 0, less by one for each further one. They hide and return nothing:
light goes through them and gets lost behind."""
PART_COLUMNS = (*GEOMETRY, "front", "rear", "side")
"""A part: box of its bottom and height, and how far its top stays behind it: at the front, at the
rear, and on each of the two sides; metres."""
TRUCK_LENGTH = 4.0
"""The class Cyclist holds box trucks too: what is longer than this, in metres, is one."""
MOTORCYCLE_LENGTH = 1.95
"""A two-wheeler at least so long, in metres, is a motorcycle, a shorter one a bicycle."""
RIDER_HEIGHT = 1.25
"""A two-wheeler lower than this, in metres, carries nobody: it is parked, or its rider has a label
of his own. Argoverse 2 has both: 80 % of its bicycles are 1.12 to 1.24 m high."""
MARGIN_M = (0.07, 0.13, 0.06)
"""Depth of the surfaces of cars and trucks inside of a label: at ends, sides, and top; metres.

With the slant of nose and doors the returns end 0.13 m inside of ends and sides; real ones 0.11 and
0.13 m, the top 0.06 m (medians over 43 cars in 3 sweeps of Argoverse 2, 98 % quantiles of points in
a box). The own body, whose size is known, has no margin."""
_LARGEST_MARGIN = 0.2  # as a share of a side: of boxes that are smaller than any vehicle
_DRAWS = 5  # uniform numbers of an object: the first chooses a variant
_MOST_PARTS = 8
_PROUD = 0.002
"""Length by which plates and lamps stand out of the body, as a share: a centimetre."""
_EAVES = 0.82
"""Height of a car's roof over its windows, as a share of its own."""


@dataclass(frozen=True)
class Parts:
    """Convex parts in the ego frame.

    Attributes:
        geometry: rows of `PART_COLUMNS`, shape (P, 10), float64, metres and radians.
        owner: row of the object that a part belongs to, or BUILDING, SIGN, BODY or that of a
            window, see PANE, shape (P,), int32; parts of one object follow each other, windows at
            the end.
        reflectivity: share of the light that comes back at normal incidence, in terms of a white
            diffuser; of retroreflectors more than 1; shape (P,), float64."""

    geometry: NDArray[np.float64]
    owner: NDArray[np.int32]
    reflectivity: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.owner)

    def and_(self, others: "Parts") -> "Parts":
        """Return these parts, followed by others."""
        return Parts(
            np.concatenate([self.geometry, others.geometry]),
            np.concatenate([self.owner, others.owner]),
            np.concatenate([self.reflectivity, others.reflectivity]),
        )


def between(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return level boxes by their lowest and highest corners, shape (m, 2, 3).

    Rows are those of `lidarplace.logs.boxes.GEOMETRY`, shape (m, 7), metres."""
    low, high = corners[:, 0], corners[:, 1]
    return np.concatenate([(low + high) / 2, high - low, np.zeros((len(low), 1))], axis=1)


def bricks(
    boxes: NDArray[np.float64],
    owner: NDArray[np.int32] | int,
    reflectivity: NDArray[np.float64] | float = 1.0,
) -> Parts:
    """Return boxes, rows of `GEOMETRY`, shape (P, 7), as parts."""
    number = len(boxes)
    return Parts(
        np.concatenate([boxes, np.zeros((number, 3))], axis=1),
        np.broadcast_to(np.asarray(owner, np.int32), number).copy(),
        np.broadcast_to(np.asarray(reflectivity, np.float64), number).copy(),
    )


@dataclass(frozen=True)
class Shapes:
    """Shapes of the objects of a table of boxes.

    `unit` are the parts of every different shape, as shares of the box, shape (S, _MOST_PARTS, 10):
    the fields of `Part`, with its reflectivity in the place of the material; else NaN. `of_row` is
    the shape of every row of the table; `margin` that of every shape, see `MARGIN_M`, (S, 3)."""

    unit: NDArray[np.float64]
    of_row: NDArray[np.int64]
    margin: NDArray[np.float64]

    def parts(self, rows: NDArray[np.int64], geometry: NDArray[np.float64]) -> Parts:
        """Return the parts of the objects in `rows` of the table.

        Their boxes are `geometry`, shape (B, 7); owners are numbered from 0 in the order of
        `rows`."""
        unit = self.unit[self.of_row[rows]]
        x0, x1, width, z0, z1, front, rear, side, reflects, left = np.moveaxis(unit, 2, 0)
        margin = np.minimum(self.margin[self.of_row[rows]], _LARGEST_MARGIN * geometry[:, 3:6])
        length, breadth, height = (geometry[:, 3:6] - margin * (2.0, 2.0, 1.0)).T[:, :, None]
        x, y, z, yaw = geometry[:, [0, 1, 2, 6]].T[:, :, None]
        z = z - 0.5 * margin[:, 2:]
        along, aside = length * (0.5 * (x0 + x1) - 0.5), breadth * left
        columns = (
            x + np.cos(yaw) * along - np.sin(yaw) * aside,
            y + np.sin(yaw) * along + np.cos(yaw) * aside,
            z + height * (0.5 * (z0 + z1) - 0.5),
            length * (x1 - x0),
            breadth * width,
            height * (z1 - z0),
            np.broadcast_to(yaw, x0.shape),
            length * front,
            length * rear,
            breadth * side,
        )
        filled = ~np.isnan(x0)
        numbers = np.arange(len(rows), dtype=np.int32)[:, None]
        owner = np.where(reflects == 0.0, PANE - numbers, numbers)
        return Parts(np.stack(columns, axis=2)[filled], owner[filled], reflects[filled])


def shapes_of(boxes: pd.DataFrame, seed: int = 0) -> Shapes:
    """Draw the shapes of all objects of a box log; needs `object_id`, `class` and sizes."""
    if "object_id" not in boxes.columns:
        found = list(boxes.columns)
        raise InputError("missing column", place="box log", key="object_id", found=found)
    codes, unique = pd.factorize(boxes["object_id"], use_na_sentinel=False)
    ids = unique.tolist()
    draws = _drawn(ids, seed, _DRAWS)
    kinds = _kinds(boxes, draws[codes, 0])
    different, of_row = np.unique(codes * len(_KINDS) + kinds, return_inverse=True)
    unit = np.full((len(different), _MOST_PARTS, len(Part._fields)), np.nan)
    for row, code in enumerate(different.tolist()):
        parts = _KINDS[code % len(_KINDS)](*draws[code // len(_KINDS), 1:].tolist())
        unit[row, : len(parts)] = parts
    shares = _drawn(ids, seed, _MOST_PARTS, b"reflectivity")[different // len(_KINDS)]
    material = unit[:, :, Part._fields.index("material")]
    glass = material == Material.GLASS
    opaque = ~np.isnan(material) & ~glass
    material[glass] = 0.0
    material[opaque] = reflectivity(material[opaque].astype(int), shares[opaque])
    vehicle = different % len(_KINDS) < len(_VEHICLES)
    return Shapes(unit, of_row.reshape(len(boxes)), vehicle[:, None] * np.array(MARGIN_M))


def _drawn(
    ids: Sequence[object], seed: int, number: int, purpose: bytes = b""
) -> NDArray[np.float64]:
    """Return uniform numbers of every object, shape (ids, number)."""
    rows = [uniforms(f"{seed}/{object_id}", number, purpose) for object_id in ids]
    return np.array(rows).reshape(len(ids), number)


def _kinds(boxes: pd.DataFrame, draw: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the index into `_KINDS` of every row."""
    name = boxes["class"].to_numpy(str)
    length, height = (boxes[side].to_numpy(np.float64) for side in ("length", "height"))
    car, cyclist = name == "Car", name == "Cyclist"
    kind = [
        (car & (draw < 0.40), _SEDAN),
        (car & (draw < 0.65), _HATCHBACK),
        (car & (draw < 0.93), _SUV),
        (car, _PICKUP),
        (cyclist & (length > TRUCK_LENGTH), _box_truck),
        (cyclist & (height < RIDER_HEIGHT), _parked),
        (cyclist & (length >= MOTORCYCLE_LENGTH), _motorcycle),
        (cyclist, _bicycle),
        (name == "Pedestrian", _pedestrian),
    ]
    conditions, shapes = zip(*kind, strict=True)
    return np.select(conditions, [*map(_KINDS.index, shapes)], _KINDS.index(_brick))


class Part(NamedTuple):
    """A part of an object; lengths are shares of the length, width and height of its box."""

    rear: float
    front: float
    width: float
    bottom: float
    top: float
    front_inset: float
    rear_inset: float
    side_inset: float
    material: Material
    left: float = 0.0
    """Offset of the centre of the part from that of the box."""


Draw = Callable[[float, float, float, float], Sequence[Part]]


def _drawn_car(
    belt: float,
    tail: tuple[float, float],
    windscreen: tuple[float, float],
    slope: float,
    rear_slope: float,
) -> Draw:
    """Return a function that draws cars, from the least of each measure on.

    Tail and windscreen are given with their range."""

    def draw(a: float, b: float, c: float, d: float) -> Sequence[Part]:
        foot, end = windscreen[0] + windscreen[1] * a, tail[0] + tail[1] * b
        return _car(belt + 0.04 * c, end, foot, slope + 0.03 * d, rear_slope)

    return draw


_SEDAN = _drawn_car(0.62, (0.08, 0.05), (0.70, 0.04), slope=0.15, rear_slope=0.11)
_HATCHBACK = _drawn_car(0.61, (0.01, 0.02), (0.74, 0.04), slope=0.16, rear_slope=0.07)
_SUV = _drawn_car(0.63, (0.005, 0.01), (0.73, 0.05), slope=0.11, rear_slope=0.03)
_PICKUP = _drawn_car(0.62, (0.34, 0.06), (0.72, 0.03), slope=0.10, rear_slope=0.02)


def _car(
    belt: float, tail: float, windscreen: float, slope: float, rear_slope: float
) -> Sequence[Part]:
    """Return body, axles, cabin, lights and windows of a car.

    The cabin reaches from `tail` to the foot of the windscreen above the belt; windows return
    nothing.

    Plates and lamps are bars through the whole body, of which only the ends stand out."""
    bottom, nose, back = 0.14, 0.04, 0.03
    up = (_EAVES - belt) / (1.0 - belt)
    window = up * slope, up * rear_slope, up * 0.10
    roof = slope - up * slope, rear_slope - up * rear_slope, 0.10 - up * 0.10
    back_of_roof, front_of_roof = tail + up * rear_slope, windscreen - up * slope
    paint, width_of_roof = Material.PAINT, 0.94 - 2.0 * up * 0.10

    def bar(width: float, low: float, high: float, material: Material, left: float = 0.0) -> Part:
        """Return a bar whose ends are parallel to those of the body."""
        up, steep = (low - bottom) / (belt - bottom), (high - low) / (belt - bottom)
        rear, front = back * up - _PROUD, 1.0 - nose * up + _PROUD
        return Part(rear, front, width, low, high, nose * steep, back * steep, 0.0, material, left)

    return [
        Part(0.0, 1.0, 1.0, bottom, belt, nose, back, 0.03, paint),
        Part(back_of_roof, front_of_roof, width_of_roof, _EAVES, 1.0, *roof, paint),
        Part(0.12, 0.26, 0.94, 0.0, 0.30, 0.03, 0.03, 0.0, Material.TYRE),
        Part(0.76, 0.90, 0.94, 0.0, 0.30, 0.03, 0.03, 0.0, Material.TYRE),
        bar(0.28, 0.26, 0.34, Material.RETROREFLECTOR),
        bar(0.16, 0.38, 0.47, Material.LAMP, left=0.36),
        bar(0.16, 0.38, 0.47, Material.LAMP, left=-0.36),
        Part(tail, windscreen, 0.94, belt, _EAVES, *window, Material.GLASS),
    ]


def _box_truck(a: float, b: float, c: float, d: float) -> Sequence[Part]:
    cab, roof, slope = 0.76 + 0.05 * a, 0.68 + 0.12 * c, 0.04 + 0.03 * d
    reach = 1.0 - slope * 0.10 / (roof - 0.14) + _PROUD
    lamp = slope * 0.05 / (roof - 0.14)
    return [
        Part(0.0, cab - 0.02, 1.0, 0.28 + 0.06 * b, 1.0, 0.0, 0.0, 0.0, Material.PAINT),
        Part(cab, 1.0, 0.94, 0.14, roof, slope, 0.0, 0.04, Material.PAINT),
        Part(0.02, cab, 0.5, 0.16, 0.34, 0.0, 0.0, 0.0, Material.TYRE),
        Part(0.14, 0.27, 0.94, 0.0, 0.27, 0.03, 0.03, 0.0, Material.TYRE),
        Part(0.80, 0.93, 0.92, 0.0, 0.27, 0.03, 0.03, 0.0, Material.TYRE),
        Part(0.0, 0.02, 0.9, 0.17, 0.21, 0.0, 0.0, 0.0, Material.RETROREFLECTOR),
        Part(0.9, reach, 0.12, 0.24, 0.29, lamp, 0.0, 0.0, Material.LAMP, left=0.36),
        Part(0.9, reach, 0.12, 0.24, 0.29, lamp, 0.0, 0.0, Material.LAMP, left=-0.36),
    ]


def _motorcycle(a: float, b: float, c: float, d: float) -> Sequence[Part]:
    return _two_wheeler(0.30, 0.16, 0.30 + 0.15 * a, 0.56, 0.28 + 0.06 * b, 0.12 * c)


def _bicycle(a: float, b: float, c: float, d: float) -> Sequence[Part]:
    return _two_wheeler(0.36, 0.07, 0.07 + 0.03 * a, 0.52, 0.30 + 0.06 * b, 0.08 * c)


def _two_wheeler(
    wheel: float, tyre: float, frame: float, saddle: float, back: float, lean: float
) -> Sequence[Part]:
    """Return wheels, frame, a rider whose back begins at `back`, reflector and lamp."""
    rim, seat = 0.09, saddle - 0.02
    nape, face = back + 0.10 + lean, back + 0.24 + lean
    return [
        Part(0.0, wheel, tyre, 0.0, 0.36, rim, rim, 0.0, Material.TYRE),
        Part(1.0 - wheel, 1.0, tyre, 0.0, 0.36, rim, rim, 0.0, Material.TYRE),
        Part(0.18, 0.78, frame, 0.18, saddle, 0.06, 0.0, 0.0, Material.PAINT),
        Part(back, back + 0.30, 0.55, 0.14, saddle, 0.0, 0.0, 0.06, Material.CLOTHES),
        Part(back, back + 0.34, 1.0, seat, 0.87, 0.14 - lean, lean, 0.24, Material.CLOTHES),
        Part(nape, face, 0.34, 0.86, 1.0, 0.02, 0.02, 0.06, Material.SKIN),
        Part(0.08, 0.12, 0.12, 0.36, 0.42, 0.0, 0.0, 0.0, Material.RETROREFLECTOR),
        Part(0.86, 0.90, 0.12, 0.46, 0.52, 0.0, 0.0, 0.0, Material.LAMP),
    ]


def _parked(a: float, b: float, c: float, d: float) -> Sequence[Part]:
    """Return a bicycle without a rider.

    Light goes through its wheels, whose rims and tyres are narrow."""
    wheel, rim, tyre = 0.16, 0.04, 0.08
    return [
        Part(0.10, 0.10 + wheel, tyre, 0.0, 0.56, rim, rim, 0.0, Material.TYRE),
        Part(0.90 - wheel, 0.90, tyre, 0.0, 0.56, rim, rim, 0.0, Material.TYRE),
        Part(0.26, 0.74, 0.12 + 0.03 * a, 0.30, 0.60, 0.06, 0.0, 0.0, Material.PAINT),
        Part(0.26, 0.42, 0.24, 0.66 + 0.04 * b, 0.84, 0.0, 0.04, 0.04, Material.TYRE),
        Part(0.70, 0.74, 0.6 + 0.4 * c, 0.88, 1.0, 0.0, 0.0, 0.0, Material.TYRE),
        Part(0.70, 0.76, 0.10, 0.56, 0.89, 0.0, 0.0, 0.0, Material.PAINT),
        Part(0.08, 0.12, 0.12, 0.40, 0.48, 0.0, 0.0, 0.0, Material.RETROREFLECTOR),
    ]


def _pedestrian(a: float, b: float, c: float, d: float) -> Sequence[Part]:
    """Return legs, body and head of a pedestrian.

    Arms and steps fill a label, light passes between them: of rays that met a body as wide as its
    label, 31 % passed beyond on Argoverse 2."""
    hip, shoulder, head = 0.47 + 0.04 * a, 0.84 + 0.03 * b, 0.14 + 0.04 * d
    return [
        Part(0.10, 0.90, 0.40 + 0.1 * c, 0.0, hip, 0.24, 0.24, 0.04, Material.CLOTHES),
        Part(0.26, 0.74, 0.68, hip - 0.02, shoulder, 0.08, 0.08, head, Material.CLOTHES),
        Part(0.35, 0.65, 0.30, shoulder - 0.01, 1.0, 0.05, 0.05, 0.04, Material.SKIN),
    ]


def _brick(a: float, b: float, c: float, d: float) -> Sequence[Part]:
    """Return one part that fills its box, for an unknown class."""
    return [Part(0.0, 1.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, Material.PAINT)]


_VEHICLES: tuple[Draw, ...] = (_SEDAN, _HATCHBACK, _SUV, _PICKUP, _box_truck)
_KINDS = (*_VEHICLES, _motorcycle, _bicycle, _parked, _pedestrian, _brick)
OWN_BODY = (0.0, 0.0, 0.75, 4.6, 1.9, 1.5, 0.0)
"""The box of the vehicle's own body in the ego frame: a row of `GEOMETRY`."""


def own_body() -> Parts:
    """Return the parts of the vehicle's own body, a sedan. It returns no light."""
    sedan = _car(0.59, tail=0.105, windscreen=0.72, slope=0.165, rear_slope=0.11)
    solid = [part for part in sedan if part.material not in _LIGHTS]
    shape = Shapes(np.array([solid], np.float64), np.zeros(1, np.int64), np.zeros((1, 3)))
    parts = shape.parts(np.zeros(1, np.int64), np.array([OWN_BODY]))
    return Parts(parts.geometry, np.full(len(parts), BODY, np.int32), np.zeros(len(parts)))


_LIGHTS = (Material.RETROREFLECTOR, Material.LAMP)
"""They lie on the body and hide nothing that it does not."""
