"""The points of a cloud that a point network looks at."""

from collections.abc import Sequence

import torch
from torch import Tensor

from training.detectors.detector import PointRange

NEAR = 40.0  # points beyond this distance are few and all kept where possible, metres


def within(frames: Sequence[Tensor], point_range: PointRange) -> tuple[Tensor, list[int]]:
    """Select the finite points of frames (N, 4) in the range of x and y, its border included.

    At any height, as in OpenPCDet: only voxels end at the range's top and bottom. Returns them
    frame after frame, (M, 4), and the number of each frame, for which the host waits once if they
    are on a GPU."""
    points = torch.cat(list(frames))
    x, y = points[:, 0], points[:, 1]
    inside = (x >= point_range[0]) & (x <= point_range[3])
    inside &= (y >= point_range[1]) & (y <= point_range[4])
    inside &= points.isfinite().all(dim=1)
    parts = inside.split([len(frame) for frame in frames])
    counts = torch.stack([part.sum() for part in parts]).tolist()
    return points[torch.nonzero_static(inside, size=sum(counts)).flatten()], counts


def sample_points(points: Tensor, number: int, training: bool) -> Tensor:
    """Draw exactly `number` rows of `points` (N, 4), as OpenPCDet's `sample_points`.

    Too many: all farther than NEAR and a random choice of the others; if the far ones alone are too
    many, a random choice of all. Too few: every point as often as another, but for one time.

    Training draws from torch's default generator. Evaluation makes the same choice for the same
    numbers of points, and takes exactly `number` points as they are."""
    count = len(points)
    if count == 0 or (count == number and not training):
        return points
    generator = None if training else torch.Generator().manual_seed(0)

    def shuffled(size: int) -> Tensor:
        return torch.randperm(size, generator=generator).to(points.device, non_blocking=True)

    if count <= number:
        rounds = [shuffled(count) for _ in range(-(-number // count) - 1)]
        all_rows = torch.arange(count, device=points.device)
        rows = torch.cat([all_rows, *rounds])[:number]
    else:
        # Squared: a root's last bit differs between machines.
        x, y, z = points[:, :3].unbind(dim=1)
        is_far = x * x + y * y + z * z >= NEAR**2
        far = torch.nonzero(is_far).flatten()
        near = torch.nonzero_static(~is_far, size=count - len(far)).flatten()
        if len(far) >= number:
            near, far = torch.arange(count, device=points.device), far[:0]
        rows = torch.cat([near[shuffled(len(near))[: number - len(far)]], far])
    return points[rows[shuffled(number)]]
