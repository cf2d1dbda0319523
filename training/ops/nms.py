"""Non-maximum suppression of rotated boxes seen from above."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from training.ops.rotated_iou import unsuppressed


def nms(
    boxes: ArrayLike, scores: ArrayLike, threshold: float, pre: int = 4096, post: int = 500
) -> NDArray[np.int64]:
    """Indices of the boxes that survive, highest score first, shape (K,).

    A box is dropped if its IoU from above with a kept box of higher score is greater than
    `threshold`. Equal scores keep their order.

    Args:
        boxes: (N, 7), metres and radians, any frame with z up.
        scores: (N,).
        threshold: largest IoU that two kept boxes may have.
        pre: only the so many highest scores take part (OpenPCDet's NMS_PRE_MAXSIZE).
        post: at most so many are kept (NMS_POST_MAXSIZE).
    """
    order = np.argsort(-np.asarray(scores), kind="stable")[:pre]
    return order[unsuppressed(np.asarray(boxes)[order], threshold, post)]
