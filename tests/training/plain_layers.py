"""Layers on rows as torch's layers for images, and set abstraction by loops."""

import torch
from torch import nn
from torch.nn import functional


def waken(module):
    """Switch to evaluation mode, with batch norms that are no identity."""
    for name, value in module.state_dict().items():
        if name.endswith("running_mean"):
            value.uniform_(-0.5, 0.5)
        elif name.endswith(("running_var", ".bias")):
            value.uniform_(0.1, 1.5)
    return module.eval()


def as_images(layers, image):
    """1 × 1 convolutions, batch norms and what follows, on an image (N, C, H, W)."""
    for layer in layers:
        if isinstance(layer, nn.Conv2d | nn.Linear):
            weight = layer.weight.flatten(1)[..., None, None]
            image = functional.conv2d(image, weight, layer.bias)
        elif isinstance(layer, nn.BatchNorm1d):
            running = layer.running_mean.clone(), layer.running_var.clone()
            kind = layer.training, layer.momentum, layer.eps
            image = functional.batch_norm(image, *running, layer.weight, layer.bias, *kind)
        else:
            image = layer(image)
    return image


def ball_features(module, xyz, features, place):
    """Features of one place by a set abstraction, as images of one row."""
    result = []
    for radius, samples, layers in zip(module.radii, module.samples, module.mlps, strict=True):
        near = ((xyz - place).norm(dim=1) < radius).nonzero().flatten()[:samples]
        rows = torch.zeros(1, 3 + features.shape[1]).double()
        if len(near):
            rows = torch.cat([xyz[near] - place, features[near]], dim=1)
        result.append(as_images(layers, rows.t()[None, :, :, None]).amax(dim=(0, 2, 3)))
    return torch.cat(result)
