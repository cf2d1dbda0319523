"""PointRCNN (Shi et al., CVPR 2019)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor
from torch.nn.utils.rnn import pad_sequence

from training.detectors.backbones.point_sampling import sample_points, within
from training.detectors.backbones.pointnet2 import AbstractionSettings, PointNet2, PointNet2Settings
from training.detectors.detector import Detector, PointRange, Rows, Selection, builder, fitted_range
from training.detectors.heads.point_head import PointHeadBox, PointOutput, point_targets
from training.detectors.heads.pointrcnn_head import PointRCNNHead, PointRoiSettings, ScoredPoints
from training.detectors.heads.proposals import Proposals, Suppression
from training.detectors.heads.roi_targets import RoiSampling, sample_rois
from training.typical_objects import Size, TypicalObject


@dataclass(frozen=True)
class PointRCNNPreset:
    """Everything that fixes a PointRCNN network but its classes."""

    point_range: PointRange  # default range in the model's frame, metres
    sensor_height: float  # height of the model's origin above the ground, metres
    points: int  # of each frame, chosen or repeated
    backbone: PointNet2Settings  # features of the points
    hidden: tuple[int, ...]  # outputs of the point head's hidden layers, for class and box
    sizes: Mapping[str, Size]  # of a typical object of each class
    either_way: bool  # as in PointHeadBox
    second_stage: PointRoiSettings  # what is done with the proposals
    selection: Selection  # how boxes become detections

    def with_typical(self, typical: Sequence[TypicalObject]) -> "PointRCNNPreset":
        """The preset with the sizes of these objects for their classes."""
        return replace(self, sizes={**self.sizes, **{item.name: item.size for item in typical}})


OPENPCDET = PointRCNNPreset(
    point_range=(0.0, -40.0, -3.0, 70.4, 40.0, 1.0),
    sensor_height=1.73,
    points=16384,
    backbone=PointNet2Settings(
        levels=(
            AbstractionSettings((0.1, 0.5), (16, 32), ((16, 16, 32), (32, 32, 64)), 4096),
            AbstractionSettings((0.5, 1.0), (16, 32), ((64, 64, 128), (64, 96, 128)), 1024),
            AbstractionSettings((1.0, 2.0), (16, 32), ((128, 196, 256), (128, 196, 256)), 256),
            AbstractionSettings((2.0, 4.0), (16, 32), ((256, 256, 512), (256, 384, 512)), 64),
        ),
        propagation=((128, 128), (256, 256), (512, 512), (512, 512)),
    ),
    hidden=(256, 256),
    sizes={"Car": (3.9, 1.6, 1.56), "Pedestrian": (0.8, 0.6, 1.73), "Cyclist": (1.76, 0.6, 1.73)},
    either_way=False,
    second_stage=PointRoiSettings(
        train=Suppression(nms=0.8, pre=9000, post=512),
        test=Suppression(nms=0.85, pre=9000, post=100),
        sampling=RoiSampling("cls", cls_foreground=0.6, cls_background=0.45),
        points=512,
        margin=0.0,
        local=(128, 128),
        levels=(
            AbstractionSettings((0.2,), (16,), ((128, 128, 128),), 128),
            AbstractionSettings((0.4,), (16,), ((128, 128, 256),), 32),
        ),
        mlp=(256, 256, 512),
        hidden=(256, 256),
    ),
    selection=Selection(score=0.1, nms=0.1),
)
"""OpenPCDet's tools/cfgs/kitti_models/pointrcnn.yaml, in KITTI's LiDAR frame."""

PAPER = replace(OPENPCDET, point_range=(0.0, -20.0, -3.0, 40.0, 20.0, 1.0))
"""The paper's fork changes the range alone; the typical sizes stay KITTI's."""

TINY = PointRCNNPreset(
    point_range=(0.0, -20.0, 0.0, 40.0, 20.0, 4.0),
    sensor_height=0.0,
    points=2048,
    backbone=PointNet2Settings(
        levels=(
            AbstractionSettings((0.6, 2.0), (8, 16), ((16, 16), (16, 32)), 512),
            AbstractionSettings((2.5, 5.0), (8, 16), ((32, 64), (32, 64)), 128),
        ),
        propagation=((64, 64), (64,)),
    ),
    hidden=(64,),
    sizes=OPENPCDET.sizes,
    either_way=True,
    second_stage=PointRoiSettings(
        train=Suppression(nms=0.8, pre=1024, post=128),
        test=Suppression(nms=0.7, pre=1024, post=64),
        sampling=RoiSampling("cls", 0.55, cls_background=0.3, rois=48, regression=0.35),
        points=64,
        margin=1.0,
        local=(32,),
        levels=(AbstractionSettings((0.8,), (8,), ((32, 64),), 16),),
        mlp=(64, 128),
        hidden=(64, 64),
    ),
    selection=Selection(score=0.1, nms=0.1),
)

PRESETS = {"openpcdet": OPENPCDET, "paper": PAPER, "tiny": TINY}


class PointRCNN(Detector):
    """Every point proposes a box; a second stage looks at the points in the best of them."""

    def __init__(
        self, classes: Sequence[str], preset: PointRCNNPreset, point_range: PointRange | None = None
    ) -> None:
        fitted = fitted_range(preset.point_range, preset.sensor_height, point_range)
        super().__init__(classes, fitted, preset.sensor_height, preset.selection)
        self.points = preset.points
        sizes = [preset.sizes[name] for name in self.classes]
        self.backbone_3d = PointNet2(1, preset.backbone)
        features = self.backbone_3d.outputs
        self.point_head = PointHeadBox(features, preset.hidden, sizes, preset.either_way)
        self.roi_head = PointRCNNHead(features, preset.second_stage)

    def first_stage(self, frames: Sequence[Tensor]) -> tuple[ScoredPoints, PointOutput]:
        """Features and raw outputs of the points that are chosen from frames (N, 4)."""
        inside, counts = within(frames, self.point_range)
        parts = inside.split(counts)
        chosen = [sample_points(part, self.points, self.training) for part in parts]
        counts = [len(frame) for frame in chosen]
        points = torch.cat(chosen).to(self.point_head.sizes, non_blocking=True)
        xyz = points[:, :3].contiguous()
        features = self.backbone_3d(xyz, counts, points[:, 3:])
        output = self.point_head(features)
        scores = output.logits.detach().amax(dim=1).sigmoid()
        return ScoredPoints(xyz, counts, features, scores), output

    def propose(self, points: ScoredPoints, output: PointOutput) -> Proposals:
        """Propose the best boxes of the points of each frame."""
        parts = output.logits, self.point_head.decode(output, points.xyz)
        # A box of what fills up is not finite, and no proposal.
        padded = (pad_sequence(part.split(points.counts), True, torch.nan) for part in parts)
        return self.roi_head.propose(*padded)

    def loss(self, points: Rows, boxes: Rows, labels: Rows) -> dict[str, Tensor]:
        """Compute "loss" and its parts point_cls, point_box, rcnn_cls, rcnn_reg, rcnn_corner."""
        boxes, labels = self.objects(boxes, labels)
        scored, output = self.first_stage(points)
        boxes = [item.to(scored.xyz) for item in boxes]
        targets = point_targets(scored.xyz, scored.counts, boxes, labels)
        sampling = self.roi_head.settings.sampling
        rois = sample_rois(self.propose(scored, output), boxes, labels, sampling)
        losses = self.point_head.loss(output, targets, scored.xyz)
        losses |= self.roi_head.loss(self.roi_head(rois.rois.boxes, scored), rois)
        return {"loss": torch.stack(list(losses.values())).sum(), **losses}

    @torch.no_grad()
    def predict(self, points: Rows, selection: Selection | None = None) -> list[dict[str, Tensor]]:
        """Detections and refined boxes of every frame, see Detector."""
        self.eval()
        scored, output = self.first_stage(points)
        proposals = self.propose(scored, output)
        refined = self.roi_head(proposals.boxes, scored)
        return self.roi_head.detections(refined, proposals, selection or self.selection)


build = builder(PointRCNN, PRESETS)
