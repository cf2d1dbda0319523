"""PointNet++ with multi-scale grouping: features of every point of a cloud.

PointNet++ (Qi et al., NeurIPS 2017), as PointRCNN (Shi et al., CVPR 2019) uses it."""

from collections.abc import Sequence
from dataclasses import dataclass

from torch import Tensor, nn
from torch.nn import functional

from training.detectors.backbones.set_abstraction import BallSettings, PointMlp, SetAbstraction
from training.ops.grouping import stacked_counts
from training.ops.interpolation import interpolate, inverse_distance_weights, three_nn
from training.ops.sampling import furthest_point_sample


@dataclass(frozen=True)
class AbstractionSettings(BallSettings):
    """One level of set abstraction."""

    places: int  # chosen from the points of a frame


@dataclass(frozen=True)
class PointNet2Settings:
    """Levels of set abstraction, and the layers of the propagation back to each level's points."""

    levels: tuple[AbstractionSettings, ...]
    propagation: tuple[tuple[int, ...], ...]


class FeaturePropagation(nn.Module):
    """Features of points from the `inputs` of fewer places, interpolated, and their own `skip`."""

    def __init__(self, inputs: int, skip: int, mlp: Sequence[int]) -> None:
        super().__init__()
        self.inputs = inputs
        self.mlp = PointMlp([inputs + skip, *mlp])

    def forward(
        self,
        xyz: Tensor,
        counts: Tensor,
        features: Tensor,
        places: Tensor,
        place_counts: Tensor,
        place_features: Tensor,
    ) -> Tensor:
        """Features (N, mlp[-1]) of points xyz (N, 3), `counts` (B,) a frame, with `features`."""
        skipped = functional.linear(features, self.mlp.first[:, self.inputs :])
        distance, idx = three_nn(xyz, counts, places, place_counts)
        # Convolution and interpolation are both linear: places are fewer than points.
        rows = functional.linear(place_features, self.mlp.first[:, : self.inputs])
        rows = interpolate(rows, idx, inverse_distance_weights(distance))
        return self.mlp.after_first(skipped + rows)


class AbstractionLevels(nn.ModuleList):
    """Set abstraction to ever fewer places; `channels` are those before and after each level."""

    def __init__(self, inputs: int, levels: Sequence[AbstractionSettings]) -> None:
        super().__init__()
        self.places = tuple(level.places for level in levels)
        self.channels = [inputs]
        for level in levels:
            module = SetAbstraction(self.channels[-1], level)
            self.append(module)
            self.channels.append(module.outputs)

    def descend(
        self, xyz: Tensor, counts: Sequence[int], features: Tensor
    ) -> list[tuple[Tensor, Tensor, Tensor]]:
        """List the arguments, then for each level the places, their number a frame, features."""
        levels = [(xyz, stacked_counts(counts, xyz.device), features)]
        for places, module in zip(self.places, self, strict=False):
            rows, counts = furthest_point_sample(levels[-1][0], counts, places)
            new = levels[-1][0][rows], stacked_counts(counts, xyz.device)
            levels.append((*new, module(*levels[-1], *new)))
        return levels


class PointNet2(nn.Module):
    """Set abstraction, then propagation back to all points."""

    def __init__(self, inputs: int, settings: PointNet2Settings) -> None:
        super().__init__()
        self.outputs = settings.propagation[0][-1]
        self.SA_modules = AbstractionLevels(inputs, settings.levels)
        channels = self.SA_modules.channels
        inputs_of_levels = [*(mlp[-1] for mlp in settings.propagation[1:]), channels[-1]]
        self.FP_modules = nn.ModuleList(
            FeaturePropagation(*sizes)
            for sizes in zip(inputs_of_levels, channels, settings.propagation, strict=False)
        )

    def forward(self, xyz: Tensor, counts: Sequence[int], features: Tensor) -> Tensor:
        """Features (N, outputs) of points xyz (N, 3), `counts` of each frame, with `features`."""
        levels = self.SA_modules.descend(xyz, counts, features)
        features = levels[-1][2]
        for level in reversed(range(len(self.FP_modules))):
            module = self.FP_modules[level]
            features = module(*levels[level], *levels[level + 1][:2], features)
        return features
