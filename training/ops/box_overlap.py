"""Overlap of rotated boxes as tensors, on any device, in float64; gradients do not flow.

On a CPU the kernels of `rotated_iou`, elsewhere the same clipping for all pairs of boxes at once.
"""

import torch
from torch import Tensor

from training.ops import rotated_iou
from training.ops.grouping import chunks

_CLIPPED = 1 << 19  # pairs that are clipped at once


def iou_3d(a: Tensor, b: Tensor) -> Tensor:
    """IoU of the volumes of boxes (N, 7) and (M, 7), shape (N, M), in the dtype of `a`.

    Raises ValueError for a wrong shape, a negative size or a value not finite."""
    if not a.is_cpu:
        return _iou_torch(a, b).to(a.dtype)
    return torch.from_numpy(rotated_iou.iou_3d(a.detach().numpy(), b.detach().numpy())).to(a.dtype)


def _iou_torch(a: Tensor, b: Tensor) -> Tensor:
    a, b = checked(a), checked(b)
    out = a.new_zeros(len(a), len(b))
    for part in chunks(len(a), len(b)):
        row, column = near(a[part], b).nonzero(as_tuple=True)
        row = part.start + row
        out[row, column] = pair_iou(a[row], b[column], three_d=True)
    return out


def checked(boxes: Tensor) -> Tensor:
    """Return the boxes (N, 7) in float64, without history; raises ValueError as `iou_3d` does."""
    boxes = boxes.detach().double()
    rotated_iou.checked(boxes.cpu())
    return boxes


def near(a: Tensor, b: Tensor) -> Tensor:
    """Test if the circles around boxes (N, 7) and (M, 7) touch, (N, M) bool; others share none."""
    dx, dy = (a[:, None, axis] - b[:, axis] for axis in range(2))
    reach = torch.hypot(a[:, 3], a[:, 4])[:, None] + torch.hypot(b[:, 3], b[:, 4])
    return 4 * (dx * dx + dy * dy) <= reach * reach


def pair_iou(a: Tensor, b: Tensor, three_d: bool) -> Tensor:
    """IoU of row i of `a` (P, 7) and row i of `b` (P, 7), float64, shape (P,)."""
    if len(a) > _CLIPPED:
        parts = zip(a.split(_CLIPPED), b.split(_CLIPPED), strict=True)
        return torch.cat([pair_iou(*part, three_d) for part in parts])
    size_a, size_b = a[:, 3] * a[:, 4], b[:, 3] * b[:, 4]
    common = torch.minimum(_intersection(a, b), torch.minimum(size_a, size_b))
    if three_d:
        top = torch.minimum(a[:, 2] + 0.5 * a[:, 5], b[:, 2] + 0.5 * b[:, 5])
        bottom = torch.maximum(a[:, 2] - 0.5 * a[:, 5], b[:, 2] - 0.5 * b[:, 5])
        size_a, size_b = size_a * a[:, 5], size_b * b[:, 5]
        common = torch.minimum(common * (top - bottom).clamp_min(0), torch.minimum(size_a, size_b))
    union = size_a + size_b - common
    return torch.where(union > 0, common / union, 0)


def _intersection(a: Tensor, b: Tensor) -> Tensor:
    """Area common to rectangles (P, 7) and (P, 7): `b`'s corners in `a`'s frame, clipped to `a`."""
    dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
    cos_a, sin_a = a[:, 6].cos(), a[:, 6].sin()
    cos, sin = (b[:, 6] - a[:, 6]).cos()[:, None], (b[:, 6] - a[:, 6]).sin()[:, None]
    u = b[:, 3:4] * b.new_tensor([0.5, -0.5, -0.5, 0.5])
    v = b[:, 4:5] * b.new_tensor([0.5, 0.5, -0.5, -0.5])
    x = (cos_a * dx + sin_a * dy)[:, None] + cos * u - sin * v
    y = (cos_a * dy - sin_a * dx)[:, None] + sin * u + cos * v
    for side in (1.0, -1.0):
        x, y = _clip(x, y, 0.5 * a[:, 3:4] - side * x)
    for side in (1.0, -1.0):
        x, y = _clip(x, y, 0.5 * a[:, 4:5] - side * y)
    # Relative to one corner: small numbers, no cancellation.
    x, y = x - x[:, :1], y - y[:, :1]
    return 0.5 * (x * y.roll(-1, 1) - x.roll(-1, 1) * y).sum(dim=1).abs()


def _clip(x: Tensor, y: Tensor, inside: Tensor) -> tuple[Tensor, Tensor]:
    """Cut convex polygons (P, V) to where `inside` (P, V) is not negative, shape (P, V + 1).

    One step of Sutherland and Hodgman, 1974. Spare vertices repeat the first one, which leaves the
    area as it is; a polygon that is cut away is one point."""
    following = inside.roll(-1, 1)
    t = inside / torch.where(inside == following, 1, inside - following)
    crossing_x, crossing_y = x + t * (x.roll(-1, 1) - x), y + t * (y.roll(-1, 1) - y)
    valid = torch.stack([inside >= 0, inside * following < 0], dim=2).flatten(1)
    # Valid vertices to the front in their order; the last place takes all others.
    place = torch.where(valid, valid.cumsum(1) - 1, x.shape[1] + 1)
    out = []
    for old, crossing in ((x, crossing_x), (y, crossing_y)):
        vertices = torch.stack([old, crossing], dim=2).flatten(1)
        clipped = x.new_zeros(len(x), x.shape[1] + 2).scatter_(1, place, vertices)[:, :-1]
        spare = torch.arange(clipped.shape[1], device=x.device) >= valid.sum(dim=1, keepdim=True)
        out.append(torch.where(spare, clipped[:, :1], clipped))
    return out[0], out[1]
