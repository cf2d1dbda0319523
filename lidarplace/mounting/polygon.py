"""Simple polygons in a plane, down to segments and points: sections, halves, nearest points.

A polygon is a tuple of vertices, (x, y) in metres; its boundary belongs to it. Vertices lie on a
grid of a nanometre, so that what is meant to coincide does."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import combinations, pairwise

from lidarplace.base.errors import InputError
from lidarplace.base.roi import Interval

Vertex = tuple[float, float]
Polygon = tuple[Vertex, ...]
GRID_DIGITS = 9
NANOMETRE = 1e-9


def polygon(vertices: Iterable[Vertex]) -> Polygon:
    """Return the polygon of these vertices: rounded, without repetitions, maybe a segment or point.

    Raises ValueError for no vertex, one that is not finite, or edges that cross or touch."""
    rounded = [(round(float(x), GRID_DIGITS), round(float(y), GRID_DIGITS)) for x, y in vertices]
    if not rounded:
        raise InputError(key="polygon", expected="at least one vertex", found="none")
    for vertex in rounded:
        if not all(map(math.isfinite, vertex)):
            raise InputError(key="polygon", expected="finite vertices", found=vertex)
    result = tuple(a for a, b in _edges(tuple(rounded)) if a != b) or (rounded[0],)
    first, last = min(result), max(result)
    length = math.dist(first, last)
    if all(abs(_cross(first, last, v)) <= 2 * NANOMETRE * length for v in result):
        return (first,) if first == last else (first, last)
    clash = _clash(result)
    if clash:
        (a, b), (c, d) = clash
        touch = f"{a} to {b} and {c} to {d} in contact"
        raise InputError(key="polygon", expected="edges that meet at their ends only", found=touch)
    return result


def sections(vertices: Polygon, axis: int, value: float) -> list[Interval]:
    """Return intervals on the line on which one coordinate, 0 for x and 1 for y, has a `value`.

    Ascending intervals of the other coordinate, of zero width where a tip touches the line."""
    other = 1 - axis
    cuts: set[float] = set()
    on_line, across = [], []
    for a, b in _edges(vertices):
        if a[axis] == b[axis] == value:
            on_line.append((min(a[other], b[other]), max(a[other], b[other])))
            cuts |= {a[other], b[other]}
        elif min(a[axis], b[axis]) <= value <= max(a[axis], b[axis]):
            cut = _crossing(a, b, axis, value)
            cuts.add(cut)
            if (a[axis] <= value) != (b[axis] <= value):
                across.append(cut)
    intervals: list[Interval] = []
    ends = sorted(cuts)
    if ends:
        intervals.append((ends[0], ends[0]))
    for low, high in pairwise(ends):
        inside = sum(cut >= high for cut in across) % 2 == 1
        if inside or any(start <= low and high <= end for start, end in on_line):
            intervals[-1] = (intervals[-1][0], high)
        else:
            intervals.append((high, high))
    return intervals


def nearest(vertices: Polygon, x: float, y: float) -> Vertex:
    """Return the point of the polygon that is closest to (x, y)."""
    if any(low <= y <= high for low, high in sections(vertices, 0, x)):
        return x, y
    return nearest_of_boundary(vertices, x, y)


def nearest_of_boundary(vertices: Polygon, x: float, y: float) -> Vertex:
    """Return the point of the boundary that is closest to (x, y)."""
    feet = [_foot(a, b, (x, y)) for a, b in _edges(vertices)]
    return min(feet, key=lambda foot: math.dist(foot, (x, y)))


def above_x_axis(vertices: Polygon) -> Polygon | None:
    """Return the part with y >= 0; None without any y > 0, ValueError if it is in pieces."""
    if max(y for _, y in vertices) <= 0:
        return None
    corners: list[Vertex] = []
    for a, b in _edges(vertices):  # Sutherland and Hodgman 1974
        if a[1] >= 0:
            corners.append(a)
        if min(a[1], b[1]) < 0 < max(a[1], b[1]):
            corners.append((_crossing(a, b, 1, 0.0), 0.0))
    try:
        return polygon(_without_spikes(corners))
    except ValueError:  # what joins the pieces runs along y = 0, to and fro
        one, fix = "one piece with y > 0", "split the zone"
        raise InputError(expected=one, found="several", fix=fix) from None


def _without_spikes(vertices: list[Vertex]) -> list[Vertex]:
    """Remove the vertices where the boundary turns back on y = 0."""
    rest = list(vertices)
    i = 0
    while i < len(rest) and len(rest) > 2:
        (xa, ya), (xb, yb), (xc, yc) = rest[i - 1], rest[i], rest[(i + 1) % len(rest)]
        if ya == yb == yc == 0 and (xa - xb) * (xc - xb) >= 0:
            del rest[i]
            i = 0
        else:
            i += 1
    return rest


def _edges(vertices: Polygon) -> Iterator[tuple[Vertex, Vertex]]:
    """Return edges from each vertex to the next one, the last to the first."""
    return zip(vertices, vertices[1:] + vertices[:1], strict=True)


def _crossing(a: Vertex, b: Vertex, axis: int, value: float) -> float:
    """Return the other coordinate where the edge has `value`, whatever the order of a and b."""
    (start, end), other = sorted((a, b)), 1 - axis
    if value == end[axis]:
        return end[other]
    share = (value - start[axis]) / (end[axis] - start[axis])
    return start[other] + share * (end[other] - start[other])


def _foot(a: Vertex, b: Vertex, point: Vertex) -> Vertex:
    """Return the point of the edge that is closest to `point`."""
    ex, ey = b[0] - a[0], b[1] - a[1]
    square = ex * ex + ey * ey
    along = (point[0] - a[0]) * ex + (point[1] - a[1]) * ey
    share = min(max(along / square, 0.0), 1.0) if square else 0.0
    return a[0] + share * ex, a[1] + share * ey


def _cross(a: Vertex, b: Vertex, c: Vertex) -> float:
    """Return twice the signed area of a triangle."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _clash(vertices: Polygon) -> tuple[tuple[Vertex, Vertex], tuple[Vertex, Vertex]] | None:
    """Return two edges that meet not just at a common end; None in a simple polygon."""
    edges = list(_edges(vertices))
    for (i, first), (j, second) in combinations(enumerate(edges), 2):
        if j - i == 1 or (i == 0 and j == len(edges) - 1):
            (a, b), (_, c) = (first, second) if j - i == 1 else (second, first)
            ahead = (a[0] - b[0]) * (c[0] - b[0]) + (a[1] - b[1]) * (c[1] - b[1])
            bad = _cross(a, b, c) == 0 and ahead > 0
        else:
            bad = _touch(first, second)
        if bad:
            return first, second
    return None


def _touch(first: tuple[Vertex, Vertex], second: tuple[Vertex, Vertex]) -> bool:
    """Return whether two segments have a point in common."""
    (a, b), (c, d) = first, second
    for axis in (0, 1):
        low, high = sorted((sorted((a[axis], b[axis])), sorted((c[axis], d[axis]))))
        if low[1] < high[0]:
            return False

    def apart(a: Vertex, b: Vertex, c: Vertex, d: Vertex) -> bool:
        left, right = _cross(a, b, c), _cross(a, b, d)
        return (left > 0 and right > 0) or (left < 0 and right < 0)

    return not apart(a, b, c, d) and not apart(c, d, a, b)
