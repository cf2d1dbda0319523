"""Whether a box stands in the way of a ray: the slab test."""

from __future__ import annotations

from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def stopped(origin, dx, dy, dz, reach, boxes):  # pragma: no cover - compiled
    """Whether the ray origin + t (dx, dy, dz) is inside a box for some t in (0, reach).

    Args:
        origin: metres, shape (3,).
        boxes: lower and upper corners, metres, shape (n, 2, 3). A touch of a face does not count.
    """
    for box in boxes:
        near, far = 0.0, reach
        for axis, d in enumerate((dx, dy, dz)):
            low, high = box[0, axis] - origin[axis], box[1, axis] - origin[axis]
            if d == 0.0:
                if low >= 0.0 or high <= 0.0:
                    far = -1.0
            else:
                t0, t1 = low / d, high / d
                near, far = max(near, min(t0, t1)), min(far, max(t0, t1))
        if near < far:
            return True
    return False
