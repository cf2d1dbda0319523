"""RoI-point pooling: the points inside each box, as many for every box (PointRCNN, CVPR 2019)."""

import torch
from torch import Tensor

from training.ops.grouping import chunks, first_hits, group
from training.ops.points_in_boxes import inside_boxes


def roipoint_pool(
    points: Tensor, features: Tensor, boxes: Tensor, samples: int, extra: float
) -> tuple[Tensor, Tensor]:
    """Pool the first S of the finite points (N, 3) of a frame, in their order, in each box (R, 7).

    A box with fewer repeats them in their order; `extra` metres are added to its sides before.

    Returns coordinates and features, (R, S, 3 + C), zeros where there is no point; and which boxes
    are empty, (R,) bool. Gradients flow to `features` (N, C).
    """
    large = boxes.detach().to(points).clone()
    large[:, 3:6] += extra
    idx = torch.zeros(len(boxes), samples, dtype=torch.int64, device=points.device)
    counts = torch.zeros(len(boxes), dtype=torch.int64, device=points.device)
    for part in chunks(len(boxes), len(points)):
        idx[part], counts[part] = first_hits(inside_boxes(points.detach(), large[part]), samples)
    turn = torch.arange(samples, device=points.device) % counts.clamp_min(1)[:, None]
    idx, empty = idx.gather(1, turn), counts == 0
    pooled = torch.cat([group(points, idx), group(features, idx)], dim=2)
    return pooled.masked_fill(empty[:, None, None], 0), empty
