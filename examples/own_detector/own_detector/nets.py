"""A network of your own: points seen from above, and the centres of the objects (CenterPoint)."""

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from training.detectors.detector import Detector, PointRange, Selection
from training.typical_objects import TypicalObject

CELL = 0.5  # of the image, metres
SPREAD = 1.5  # of an object's peak in the heat map, cells


class CentreNet(Detector):
    """Four features of every cell, six convolutions, and a heat map of every class."""

    def __init__(self, classes: Sequence[str], point_range: PointRange) -> None:
        super().__init__(classes, point_range)
        low, high = torch.tensor(point_range).view(2, 3)
        self.register_buffer("low", low, persistent=False)
        self.cells = [int(cells) for cells in ((high - low)[:2] / CELL).ceil()]
        layers: list[nn.Module] = []
        for inputs, outputs, dilation in ((4, 32, 1), (32, 64, 1), (64, 64, 2), (64, 64, 4)):
            layers += [
                nn.Conv2d(inputs, outputs, 3, padding=dilation, dilation=dilation, bias=False),
                nn.BatchNorm2d(outputs),
                nn.ReLU(),
            ]
        self.body = nn.Sequential(*layers)
        self.heat_head = nn.Conv2d(64, len(classes), 3, padding=1)
        nn.init.constant_(self.heat_head.bias, -4.0)  # hardly any cell is a centre
        self.box_head = nn.Conv2d(64, 8, 3, padding=1)  # dx, dy, z, ln of size, sin and cos 2 yaw

    def forward(self, points: Sequence[Tensor]) -> tuple[Tensor, Tensor]:
        """Logits of centres (B, classes, X, Y) and boxes (B, 8, X, Y)."""
        features = self.body(torch.stack([self.image(own.to(self.device)) for own in points]))
        return self.heat_head(features).float(), self.box_head(features).float()

    def image(self, points: Tensor) -> Tensor:
        """How many points are in a cell, their mean height and intensity, and the highest."""
        cell = ((points[:, :2] - self.low[:2]) / CELL).floor()
        size = torch.tensor(self.cells, device=self.device)
        inside = ((cell >= 0) & (cell < size)).all(1) & points.isfinite().all(1)
        cell, points = cell[inside].long(), points[inside]
        index = cell[:, 0] * self.cells[1] + cell[:, 1]
        values = torch.cat([torch.ones_like(points[:, :1]), points[:, 2:]], 1)
        sums = values.new_zeros(self.cells[0] * self.cells[1], 3).index_add(0, index, values)
        top = sums[:, 0].new_zeros(len(sums)).scatter_reduce(0, index, points[:, 2], "amax")
        mean = sums[:, 1:] / sums[:, :1].clamp(min=1)
        image = torch.cat([sums[:, :1].log1p(), mean, top[:, None]], 1)
        return image.T.reshape(4, *self.cells)

    def loss(
        self, points: Sequence[Tensor], boxes: Sequence[Tensor], labels: Sequence[Tensor]
    ) -> dict[str, Tensor]:
        """Focal loss of the heat maps (CornerNet), and the error of the boxes at the centres."""
        logits, found = self(points)
        heat, errors = torch.zeros_like(logits), [found.sum() * 0]
        grid = torch.cartesian_prod(*(torch.arange(n, device=self.device) for n in self.cells))
        for frame, (box, label) in enumerate(zip(*self.objects(boxes, labels), strict=True)):
            centre = (box[:, :2] - self.low[:2]) / CELL
            cell = centre.long()
            for own, at, place, name in zip(box, centre, cell, label - 1, strict=True):
                if not torch.equal(place.clamp(min=0).minimum(grid[-1]), place):
                    continue  # outside of the range
                peak = (-(grid - place).square().sum(1) / (2 * SPREAD**2)).exp().view(self.cells)
                heat[frame, name] = heat[frame, name].maximum(peak)
                turn = torch.stack([(2 * own[6]).sin(), (2 * own[6]).cos()])
                wanted = torch.cat([at - place, own[2:3], own[3:6].log(), turn])
                errors.append((found[frame, :, place[0], place[1]] - wanted).abs().sum())
        centres = heat == 1
        error = functional.binary_cross_entropy_with_logits(
            logits, centres.float(), reduction="none"
        )
        weight = (centres.float() - logits.sigmoid()).square() * (1 - heat * ~centres) ** 4
        count = max(1, len(errors) - 1)
        heat_loss, box_loss = (weight * error).sum() / count, torch.stack(errors).sum() / count
        return {"loss": heat_loss + box_loss, "heat": heat_loss, "box": box_loss}

    def predict(
        self, points: Sequence[Tensor], selection: Selection | None = None
    ) -> list[dict[str, Tensor]]:
        """The peaks of the heat maps; no two are neighbours, so none have to be suppressed."""
        selection = selection or self.selection
        logits, found = self(points)
        heat = logits.sigmoid()
        heat = heat * (heat == functional.max_pool2d(heat, 3, 1, 1))
        frames = []
        for scores, values in zip(heat, found, strict=True):
            best, at = scores.flatten().topk(min(selection.post, scores.numel()))
            at = at[best >= selection.score]
            label, x, y = torch.unravel_index(at, scores.shape)
            own = values[:, x, y].T
            centre = (torch.stack([x, y], 1) + own[:, :2]) * CELL + self.low[:2]
            yaw = torch.atan2(own[:, 6], own[:, 7]) / 2
            boxes = torch.cat([centre, own[:, 2:3], own[:, 3:6].exp(), yaw[:, None]], 1)
            frames.append({"boxes": boxes, "scores": best[: len(at)], "labels": label + 1})
        return frames


def build(
    classes: Sequence[str],
    preset: str,
    point_range: PointRange | None,
    typical: Sequence[TypicalObject],
) -> Detector:
    """What `detector: own_detector.nets:build` makes."""
    return CentreNet(classes, point_range or (0.0, -20.0, 0.0, 40.0, 20.0, 4.0))
