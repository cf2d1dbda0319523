"""Outputs of OpenPCDet's networks for random weights, and comparisons with them.

tests/data/openpcdet/<model>.npz: a network of OpenPCDet's kitti_models at commit 8cacccec
(Apache-2.0). `keys`, `shapes` (JSON), `dtypes`: its state_dict. `seed`: of the weights, by the rule
in `weights`; `buffer/…`: the batch norm statistics. `classes`, `point_range`. `order_<b>`: rows of
frame b of points.npz in the order in which the network took them (for voxel networks: voxel after
voxel, the points that its voxeliser kept). `gt_boxes` (B, M, 8): boxes and label. `eval/…`: outputs
of the stages in evaluation mode, `raw/…` of the heads: `<name>/full`, or samples `<name>/index`
(of the flattened array), `/value`, its `/sum`, `/abs_sum` and `/shape`. Sparse tensors: sorted
`/coordinates` (frame, z, y, x) and `/features` in that order. `final_<b>/…`: the detections.
`train/…`: losses and norms of gradients with batch norm in evaluation mode.
"""

import json
import math
from pathlib import Path

import numpy as np
import torch

DATA = Path(__file__).parents[1] / "data" / "openpcdet"


def reference(model: str):
    """The arrays of one network."""
    return np.load(DATA / f"{model}.npz")


def keys_and_shapes(data) -> dict[str, tuple[tuple[int, ...], str]]:
    """Shape and dtype of every entry of OpenPCDet's state_dict."""
    return {
        str(key): (tuple(json.loads(str(shape))), str(dtype))
        for key, shape, dtype in zip(data["keys"], data["shapes"], data["dtypes"], strict=True)
    }


def weights(state, data):
    """Normal numbers of one RandomState, tensor by tensor in the order of the sorted keys."""
    random = np.random.RandomState(int(data["seed"]))
    result = {}
    for key in sorted(state):
        if not state[key].is_floating_point():
            result[key] = state[key]
            continue
        normal = random.standard_normal(tuple(state[key].shape))
        if state[key].ndim >= 2:
            normal *= math.sqrt(2 / (normal.size / normal.shape[0]))
        elif key.endswith(".weight"):
            normal = 1 + 0.1 * normal
        else:
            normal = 0.1 * normal
        result[key] = torch.tensor(normal, dtype=torch.float32)
    for key in state:
        if f"buffer/{key}" in data:
            result[key] = torch.from_numpy(data[f"buffer/{key}"])
    return result


def points(data) -> list[torch.Tensor]:
    """Points (N, 4) of every frame in the order in which the network took them."""
    frames = np.load(DATA / "points.npz")
    count = sum(1 for key in data if key.startswith("order_"))
    return [torch.from_numpy(frames[f"frame_{b}"][data[f"order_{b}"]]) for b in range(count)]


def of_roi_head(data, name: str) -> torch.Tensor:
    """Read a whole output of OpenPCDet's second stage."""
    return torch.from_numpy(data[f"eval/roi_head/{name}/full"])


def worst_error(data, name: str, value: torch.Tensor) -> float:
    """Largest difference of `value` from OpenPCDet's, over the largest absolute value of those."""
    ours = value.detach().cpu().numpy()
    if f"{name}/full" in data:
        expected = data[f"{name}/full"].astype(np.float64)
        assert ours.shape == expected.shape
    else:
        assert ours.size == data[f"{name}/shape"].prod() or -1 in data[f"{name}/shape"]
        expected = data[f"{name}/value"].astype(np.float64)
        ours = ours[np.unravel_index(data[f"{name}/index"], ours.shape)]
    return float(np.abs(ours - expected).max() / np.abs(expected).max())
