"""A learnt predictor of perception: whether a detector finds an object, from a point cloud.

A small convolutional network reads the pillars around an object, in the frame of the object: number
and greatest height of the points above the ground, and the outline of the box."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from lidarplace.clouds.collect import SimulatedClouds
from lidarplace.logs.boxes import CLASSES

PILLARS, PILLAR_M, GROUND_M = 32, 0.25, 0.15
EPOCHS, BATCH, LR = 5, 64, 2e-3
Pillars = NDArray[np.float32]
"""Points above the ground and height of the highest, shape (objects, 2, PILLARS, PILLARS)."""


def pillars_of(clouds: SimulatedClouds, objects: pd.DataFrame) -> Pillars:
    """Cast the clouds and sort their points into pillars around the objects, row by row."""
    pillars = np.zeros((len(objects), 2, PILLARS**2), np.float32)
    index_of = {frame: index for index, frame in enumerate(clouds.frames.tolist())}
    for frame, rows in objects.reset_index(drop=True).groupby("frame"):
        cloud = clouds[index_of[frame]]
        x, y, z = cloud[cloud[:, 2] > GROUND_M, :3].T
        for row in rows.itertuples():
            c, s, dx, dy = np.cos(row.yaw), np.sin(row.yaw), x - row.x, y - row.y
            offsets = np.stack([c * dx + s * dy, c * dy - s * dx]) / PILLAR_M
            i, j = np.floor(offsets + PILLARS / 2).astype(int)
            inside = (i >= 0) & (i < PILLARS) & (j >= 0) & (j < PILLARS)
            pillar = (i * PILLARS + j)[inside]
            pillars[row.Index, 0] = np.bincount(pillar, minlength=PILLARS**2)
            np.maximum.at(pillars[row.Index, 1], pillar, z[inside])
    return pillars.reshape(-1, 2, PILLARS, PILLARS)


def joined(a: Pillars, b: Pillars) -> Pillars:
    """Return the pillars of two rigs together."""
    return np.stack([a[:, 0] + b[:, 0], np.maximum(a[:, 1], b[:, 1])], axis=1)


class PerceptionPredictor(nn.Module):
    """The network, trained on pillars of objects with a column `found`."""

    def __init__(self, pillars: Pillars, objects: pd.DataFrame) -> None:
        super().__init__()
        torch.manual_seed(0)
        layers: list[nn.Module] = []
        for before, after in pairwise((3, 16, 32, 32)):
            layers += [nn.Conv2d(before, after, 3, 2, 1), nn.BatchNorm2d(after), nn.ReLU()]
        self.pillars = nn.Sequential(*layers, nn.Flatten())
        size = 32 * (PILLARS // 8) ** 2 + len(CLASSES) + 3
        head = nn.Linear(size, 64), nn.ReLU(), nn.Dropout(0.3), nn.Linear(64, 1)
        self.head = nn.Sequential(*head)
        found = torch.tensor(objects["found"].to_numpy(np.float32))
        self._fit(*_inputs(pillars, objects), found)
        self.eval()

    def _fit(self, images: Tensor, about: Tensor, found: Tensor) -> None:
        steps = len(found) // BATCH
        optimizer = torch.optim.AdamW(self.parameters(), LR, weight_decay=0.01)
        schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, LR, EPOCHS * steps)
        for _ in range(EPOCHS):
            for batch in torch.randperm(len(found))[: steps * BATCH].split(BATCH):
                mirrored = [axis for axis in (2, 3) if torch.rand(()) < 0.5]
                logits = self(images[batch].flip(mirrored), about[batch])
                loss = nn.functional.binary_cross_entropy_with_logits(logits, found[batch])
                optimizer.zero_grad()
                loss.backward()
                optimizer.step()
                schedule.step()

    def forward(self, images: Tensor, about: Tensor) -> Tensor:
        """Return the logit that each object is found, shape (n,)."""
        return self.head(torch.cat([self.pillars(images), about], dim=1))[:, 0]

    @torch.no_grad()
    def probabilities(self, pillars: Pillars, objects: pd.DataFrame) -> NDArray[np.float64]:
        """Return the probability that each object is found, shape (objects,)."""
        batches = zip(*(part.split(256) for part in _inputs(pillars, objects)), strict=True)
        return torch.cat([self(*batch) for batch in batches]).sigmoid().double().numpy()


def _inputs(pillars: Pillars, objects: pd.DataFrame) -> tuple[Tensor, Tensor]:
    """Return images, (n, 3, PILLARS, PILLARS), and class and size of the objects, (n, k)."""
    size = objects[["length", "width", "height"]].to_numpy(np.float32)
    middles = np.abs((np.arange(PILLARS) + 0.5 - PILLARS / 2) * PILLAR_M)
    along, across = (middles <= size[:, [axis]] / 2 for axis in (0, 1))
    outline = along[:, :, None] & across[:, None, :]
    images = np.stack([np.log1p(pillars[:, 0]), pillars[:, 1], outline], axis=1, dtype=np.float32)
    classes = objects["class"].to_numpy()[:, None] == np.array(CLASSES, object)
    about = np.concatenate([classes, size], axis=1, dtype=np.float32)
    return torch.from_numpy(images), torch.from_numpy(about)
