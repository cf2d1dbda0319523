"""A surface of triangles, and the tree over it that finds those in question.

The tree is a complete binary tree over the triangles in Morton order (Lauterbach and others 2009,
*Fast BVH Construction on GPUs*), numbered like a heap: node n has the children 2 n and 2 n + 1, so
it needs neither pointers nor a stack."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarplace.base.errors import InputError
from lidarplace.base.kernel_cache import inner, njit

_LEAF = 4  # triangles
_EDGE = 1e-9  # a ray along an edge meets a triangle at each side, in shares of the triangle
_HAIR = 1e-9  # a ray that starts on a triangle does not meet it, metres
_FAR = 3.0  # radii away a node counts as one dipole


class Tree(NamedTuple):
    """A tree as compiled code takes it.

    Attributes:
        triangles: corners, shape (T, 3, 3), metres; leaf k has those from _LEAF k on.
        bounds: lower and upper corner of what each node holds, shape (nodes + 1, 6), metres; the
            root is number 1.
        dipoles: of each node the sum of its area vectors, their middle and the radius around it
            that holds its triangles, shape (nodes + 1, 7)."""

    triangles: NDArray[np.float64]
    bounds: NDArray[np.float64]
    dipoles: NDArray[np.float64]


NO_TREE = Tree(np.empty((0, 3, 3)), np.array([[np.inf] * 3 + [-np.inf] * 3] * 2), np.zeros((2, 7)))


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles in the ego frame; those without area are left out.

    Attributes:
        vertices: metres, shape (V, 3), float64.
        faces: three vertices each, shape (F, 3), int32.

    Raises:
        ValueError: no triangle has an area, a coordinate is not finite, or a face has a vertex that
            is not there."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]

    def __post_init__(self) -> None:
        vertices = np.array(self.vertices, np.float64).reshape(-1, 3)
        faces = np.asarray(self.faces).reshape(-1, 3)
        if not np.isfinite(vertices).all():
            raise InputError(key="vertices", expected="finite coordinates")
        outside = ((faces < 0) | (faces >= len(vertices))).any(axis=1)
        if outside.any():
            most, face = len(vertices) - 1, faces[outside][0].tolist()
            raise InputError(key="faces", expected=f"vertices from 0 to {most}", found=face)
        faces = faces.astype(np.int32)
        faces = faces[np.linalg.norm(_area_vectors(vertices[faces]), axis=1) > 0]
        if not len(faces):
            raise InputError(key="faces", expected="triangles that have an area", found="none")
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)

    @property
    def triangles(self) -> NDArray[np.float64]:
        """Corners, shape (F, 3, 3), metres."""
        return self.vertices[self.faces]

    @cached_property
    def tree(self) -> Tree:
        """The tree over the triangles."""
        return _tree(self.triangles)

    @cached_property
    def ground_plan(self) -> Tree:
        """The tree over its triangles as seen from above, all at z = 0."""
        return _tree(self.triangles * [1.0, 1.0, 0.0])

    def coarse(self, edge: float) -> Mesh:
        """Return a coarse mesh for pictures: vertices in one cube of this edge, metres, are merged.

        The whole mesh where nothing would be left of it."""
        cells = np.floor(self.vertices / edge).astype(np.int64)
        _, cube, number = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
        middles = np.stack([np.bincount(cube, axis) for axis in self.vertices.T], axis=1)
        faces = np.unique(cube[self.faces], axis=0)
        try:
            return Mesh(middles / number[:, None], faces.astype(np.int32))
        except ValueError:
            return self


def depths(mesh: Mesh, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far places (P, 3) are inside of a mesh, metres, shape (P,); 0 outside."""
    within = winding_numbers(mesh, places) > 0.5
    inside = np.zeros(len(places))
    inside[within] = distances(mesh.tree, places[within])
    return np.where(inside > _HAIR, inside, 0.0)


def winding_numbers(mesh: Mesh, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how often the surface goes around each place (P, 3), without its sign, shape (P,).

    1 inside of a closed surface and 0 outside; between them near the holes of one that is open
    (Jacobson and others 2013, *Robust Inside-Outside Segmentation Using Generalized Winding
    Numbers*). What is far from a place counts as a dipole (Barill and others 2018, *Fast Winding
    Numbers for Soups and Clouds*), which changes the number by less than a hundredth."""
    return np.abs(_winding_numbers(np.asarray(places, np.float64), mesh.tree))


@njit(cache=True, nogil=True, error_model="numpy")
def distances(tree: Tree, places):
    """Return distances from places (P, 3) to the nearest triangle, shape (P,), metres."""
    nearest = np.empty(len(places))
    for p in range(len(places)):
        place, best, node = places[p], np.inf, 1
        while True:
            square = 0.0
            for axis in range(3):
                low, high = tree.bounds[node, axis], tree.bounds[node, axis + 3]
                square += max(low - place[axis], place[axis] - high, 0.0) ** 2
            if square < best:
                if 2 * node < len(tree.bounds):
                    node *= 2
                    continue
                for triangle in _triangles_of(tree, node):
                    best = min(best, _square_distance(triangle, place))
            node = _next(node)
            if node == 1:
                break
        nearest[p] = math.sqrt(best)
    return nearest


@njit(cache=True, nogil=True, error_model="numpy")
def first_hit(origin, dx, dy, dz, reach, tree: Tree):
    """Return the least t in (0, reach) at which a ray origin + t (dx, dy, dz) meets a triangle.

    `reach` if there is none. A triangle is met from either side, edges included; not by a ray in
    its plane."""
    best, node = reach, 1
    while True:
        if _enters(tree.bounds[node], origin, dx, dy, dz, best):
            if 2 * node < len(tree.bounds):
                node *= 2
                continue
            for triangle in _triangles_of(tree, node):
                t = _meets(triangle, origin, dx, dy, dz)
                if _HAIR < t < best:
                    best = t
        node = _next(node)
        if node == 1:
            return best


@inner
def _next(node):
    """The node after all that a node holds; 1 after the last."""
    node += 1
    while node & 1 == 0:
        node >>= 1
    return node


@inner
def _triangles_of(tree: Tree, leaf):
    first = _LEAF * (leaf - len(tree.bounds) // 2)
    return tree.triangles[first : first + _LEAF]


@inner
def _enters(bounds, origin, dx, dy, dz, reach):
    """Return whether a ray is in a box, its surface included, for some t in [0, reach]."""
    if bounds[0] > bounds[3]:  # it holds nothing
        return False
    near, far = 0.0, reach
    for axis in range(3):
        d = dx if axis == 0 else dy if axis == 1 else dz
        low, high = bounds[axis] - origin[axis], bounds[axis + 3] - origin[axis]
        if d == 0.0:
            if low > _HAIR or high < -_HAIR:
                return False
        else:
            # Wider by rounding and by what an edge is.
            t0, t1 = (low - _HAIR) / d, (high + _HAIR) / d
            near, far = max(near, min(t0, t1)), min(far, max(t0, t1))
    return near <= far


@inner
def _meets(triangle, origin, dx, dy, dz):
    """Return the t at which a ray meets a triangle, -1 if not (Möller and Trumbore 1997)."""
    ax, ay, az = triangle[0]
    bx, by, bz = triangle[1, 0] - ax, triangle[1, 1] - ay, triangle[1, 2] - az
    cx, cy, cz = triangle[2, 0] - ax, triangle[2, 1] - ay, triangle[2, 2] - az
    px, py, pz = dy * cz - dz * cy, dz * cx - dx * cz, dx * cy - dy * cx
    volume = bx * px + by * py + bz * pz
    if volume == 0.0:
        return -1.0
    ox, oy, oz = origin[0] - ax, origin[1] - ay, origin[2] - az
    u = (ox * px + oy * py + oz * pz) / volume
    if not -_EDGE <= u <= 1.0 + _EDGE:
        return -1.0
    qx, qy, qz = oy * bz - oz * by, oz * bx - ox * bz, ox * by - oy * bx
    v = (dx * qx + dy * qy + dz * qz) / volume
    if not (v >= -_EDGE and u + v <= 1.0 + _EDGE):
        return -1.0
    return (cx * qx + cy * qy + cz * qz) / volume


@inner
def _square_distance(triangle, place):
    """Return the square of the distance of a point from a triangle: from its plane, or an edge."""
    a, b, c = triangle[0], triangle[1], triangle[2]
    nx = (b[1] - a[1]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[1] - a[1])
    ny = (b[2] - a[2]) * (c[0] - a[0]) - (b[0] - a[0]) * (c[2] - a[2])
    nz = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    length = nx * nx + ny * ny + nz * nz
    best, over_face = np.inf, length > 0.0
    for k in range(3):
        p, q = triangle[k], triangle[(k + 1) % 3]
        ex, ey, ez = q[0] - p[0], q[1] - p[1], q[2] - p[2]
        wx, wy, wz = place[0] - p[0], place[1] - p[1], place[2] - p[2]
        edge = ex * ex + ey * ey + ez * ez
        t = (wx * ex + wy * ey + wz * ez) / edge if edge > 0.0 else 0.0
        t = min(max(t, 0.0), 1.0)
        best = min(best, (wx - t * ex) ** 2 + (wy - t * ey) ** 2 + (wz - t * ez) ** 2)
        cross = (ey * wz - ez * wy) * nx + (ez * wx - ex * wz) * ny + (ex * wy - ey * wx) * nz
        over_face &= cross >= 0.0
    if over_face:
        height = (place[0] - a[0]) * nx + (place[1] - a[1]) * ny + (place[2] - a[2]) * nz
        best = min(best, height * height / length)
    return best


@njit(cache=True, nogil=True, error_model="numpy")
def _winding_numbers(places, tree: Tree) -> NDArray[np.float64]:
    numbers = np.zeros(len(places))
    for p in range(len(places)):
        place, angle, node = places[p], 0.0, 1
        while True:
            dipole = tree.dipoles[node]
            x, y, z = dipole[3] - place[0], dipole[4] - place[1], dipole[5] - place[2]
            away = math.sqrt(x * x + y * y + z * z)
            if away > _FAR * dipole[6]:
                if away > 0.0:
                    angle += (dipole[0] * x + dipole[1] * y + dipole[2] * z) / away**3
            elif 2 * node < len(tree.bounds):
                node *= 2
                continue
            else:
                for triangle in _triangles_of(tree, node):
                    angle += _solid_angle(triangle, place)
            node = _next(node)
            if node == 1:
                break
        numbers[p] = angle / (4.0 * math.pi)
    return numbers


@inner
def _solid_angle(triangle, place):
    """Return the signed solid angle of a triangle (Van Oosterom and Strackee 1983)."""
    x, y, z = place[0], place[1], place[2]
    ax, ay, az = triangle[0, 0] - x, triangle[0, 1] - y, triangle[0, 2] - z
    bx, by, bz = triangle[1, 0] - x, triangle[1, 1] - y, triangle[1, 2] - z
    cx, cy, cz = triangle[2, 0] - x, triangle[2, 1] - y, triangle[2, 2] - z
    la = math.sqrt(ax * ax + ay * ay + az * az)
    lb = math.sqrt(bx * bx + by * by + bz * bz)
    lc = math.sqrt(cx * cx + cy * cy + cz * cz)
    volume = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
    ab, bc = ax * bx + ay * by + az * bz, bx * cx + by * cy + bz * cz
    ca = cx * ax + cy * ay + cz * az
    return 2.0 * math.atan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb)


def _area_vectors(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return normals as long as the areas, shape (F, 3)."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    return 0.5 * np.cross(b - a, c - a)


def _tree(triangles: NDArray[np.float64]) -> Tree:
    triangles = triangles[np.argsort(_morton(triangles.mean(axis=1)), kind="stable")]
    number = len(triangles)
    leaves = 1 << max(0, math.ceil(math.log2(math.ceil(number / _LEAF))))
    bounds = np.full((2 * leaves, 6), [np.inf] * 3 + [-np.inf] * 3)
    moments = np.zeros((2 * leaves, 7))  # area vector, area times middle, area
    area_vectors = _area_vectors(triangles)
    areas = np.linalg.norm(area_vectors, axis=1)[:, None]
    leaf = leaves + np.arange(number) // _LEAF
    np.minimum.at(bounds[:, :3], leaf, triangles.min(axis=1))
    np.maximum.at(bounds[:, 3:], leaf, triangles.max(axis=1))
    np.add.at(moments, leaf, np.hstack([area_vectors, areas * triangles.mean(axis=1), areas]))
    for first in (1 << level for level in range(leaves.bit_length() - 2, -1, -1)):
        left, right = slice(2 * first, 4 * first, 2), slice(2 * first + 1, 4 * first, 2)
        bounds[first : 2 * first, :3] = np.minimum(bounds[left, :3], bounds[right, :3])
        bounds[first : 2 * first, 3:] = np.maximum(bounds[left, 3:], bounds[right, 3:])
        moments[first : 2 * first] = moments[left] + moments[right]
    dipoles, held = np.zeros((2 * leaves, 7)), moments[:, 6] > 0
    middles = moments[held, 3:6] / moments[held, 6:]
    corner = np.maximum(middles - bounds[held, :3], bounds[held, 3:] - middles)
    dipoles[held] = np.hstack([moments[held, :3], middles, np.linalg.norm(corner, axis=1)[:, None]])
    return Tree(np.ascontiguousarray(triangles), bounds, dipoles)


def _morton(places: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return numbers along a curve that keeps close what is close, shape (P,)."""
    low, high = places.min(axis=0), places.max(axis=0)
    cells = ((places - low) / np.maximum(high - low, 1e-300) * 1023).astype(np.int64)
    codes = np.zeros(len(places), np.int64)
    for bit in range(10):
        for axis in range(3):
            codes |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return codes
