"""Features of neighbours, as the neighbour searches found them."""

from torch import Tensor


def group(features: Tensor, idx: Tensor) -> Tensor:
    """Rows `idx` (M, S) of `features` (N, C), shape (M, S, C); zeros if there are no features.

    Gradients flow to `features`.
    """
    if len(features) == 0:
        return features.new_zeros(*idx.shape, features.shape[1])
    return features.index_select(0, idx.flatten()).view(*idx.shape, features.shape[1])
