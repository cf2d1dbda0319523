"""Set abstraction and feature propagation against their plain form, and the choice of points."""

import pytest
import torch
from torch.nn import functional

from tests.training.plain_layers import as_images
from training.detectors.backbones.point_sampling import sample_points, within
from training.detectors.backbones.pointnet2 import FeaturePropagation
from training.detectors.backbones.set_abstraction import BallSettings, SetAbstraction


def frames(counts, seed=0, features=2):
    """Stacked random points in a cube of 2 m, float64, and their features."""
    generator = torch.Generator().manual_seed(seed)
    xyz = 2 * torch.rand(sum(counts), 3, generator=generator, dtype=torch.float64)
    rows = torch.randn(sum(counts), features, generator=generator, dtype=torch.float64)
    return xyz.float().double(), torch.tensor(counts), rows.requires_grad_()


def in_ball(xyz, place, radius, samples):
    """Rows of the first points nearer than `radius`, the first repeated; None if there is none."""
    near = [i for i in range(len(xyz)) if (xyz[i] - place).square().sum() < radius**2][:samples]
    return near + near[:1] * (samples - len(near)) if near else None


@pytest.mark.usefixtures("last_bits")
@pytest.mark.parametrize("training", [True, False])
def test_set_abstraction_is_convolution_of_every_ball(training):
    torch.manual_seed(0)
    xyz, counts, features = frames([30, 0, 50])
    balls = BallSettings((0.4, 0.8), (3, 6), ((5, 6), (7,)))
    module = SetAbstraction(2, balls).double().train(training)
    places = torch.cat([xyz[:4], xyz[40:45], torch.full((1, 3), 50.0, dtype=torch.float64)])
    propagated = module(xyz, counts, features, places, torch.tensor([4, 0, 6]))
    propagated.square().sum().backward()
    gradient, features.grad = features.grad, None
    parts = []
    for radius, samples, mlp in zip(module.radii, module.samples, module.mlps, strict=True):
        balls = []
        for i, place in enumerate(places):
            first, last = (0, 30) if i < 4 else (30, 80)
            rows = in_ball(xyz[first:last], place, radius, samples)
            if rows is None:
                balls.append(torch.zeros(samples, 5, dtype=torch.float64))
            else:
                rows = torch.tensor(rows) + first
                balls.append(torch.cat([xyz[rows] - place, features[rows]], dim=1))
        image = as_images(mlp, torch.stack(balls).permute(2, 0, 1)[None])
        parts.append(functional.max_pool2d(image, (1, samples))[0, :, :, 0].T)
    expected = torch.cat(parts, dim=1)
    torch.testing.assert_close(propagated, expected)
    expected.square().sum().backward()
    assert gradient.abs().sum() > 0
    torch.testing.assert_close(gradient, features.grad)


@pytest.mark.parametrize("training", [True, False])
def test_propagation_is_convolution_of_the_interpolated(training):
    torch.manual_seed(0)
    xyz, counts, skipped = frames([20, 0, 10], features=3)
    places, place_counts, place_features = frames([6, 0, 5], seed=1, features=4)
    places[:2] = xyz[:2]  # a place on a point: its weight is 1
    module = FeaturePropagation(4, 3, (8, 9)).double().train(training)
    propagated = module(xyz, counts, skipped, places, place_counts, place_features)
    weights = torch.zeros(30, 11, dtype=torch.float64)
    for i in range(30):
        rows = range(6) if i < 20 else range(6, 11)
        distance = (places[rows] - xyz[i]).norm(dim=1)
        near = distance.argsort()[:3]
        weight = 1 / (distance[near] + 1e-8)
        weights[i, near + rows[0]] = weight / weight.sum()
    image = torch.cat([weights @ place_features, skipped], dim=1).T[None, :, :, None]
    expected = as_images(module.mlp, image)[0, :, :, 0].T
    # Distances come in float32.
    torch.testing.assert_close(propagated, expected, rtol=1e-4, atol=1e-5)


def test_points_in_the_range():
    border = torch.tensor([[0.0, -1.0, 2.0, 0.5], [4.0, 1.0, 9.0, 0.5]])  # at any height
    outside = torch.tensor(
        [[4.1, 0.0, 2.5, 0.5], [1.0, -1.1, 2.5, 0.5], [float("nan"), 0.0, 2.5, 0.5],
         [1.0, 0.0, float("nan"), 0.5], [1.0, 0.0, 2.5, float("inf")],
         [float("-inf"), 0.0, 2.5, 0.5]]
    )  # fmt: skip
    frames = [torch.cat([border, outside]), outside, border[:1]]
    inside, counts = within(frames, (0.0, -1.0, 2.0, 4.0, 1.0, 3.0))
    assert inside.tolist() == torch.cat([border, border[:1]]).tolist()
    assert counts == [2, 0, 1]


def test_sampling_keeps_the_far_points_and_repeats_evenly():
    torch.manual_seed(0)
    points = torch.rand(1000, 4)
    points[::20, 0] += 50  # 50 far ones
    for training in (True, False):
        chosen = sample_points(points, 400, training)
        assert chosen.shape == (400, 4)
        assert len(chosen.unique(dim=0)) == 400
        assert (chosen[:, 0] > 40).sum() == 50
        assert 0 < (chosen[:200, 0] > 40).sum() < 50  # shuffled
        few = sample_points(points, 30, training)
        assert len(few.unique(dim=0)) == 30
        assert (few[:, 0] > 40).sum() < 15  # chosen from all
        _, times = sample_points(points, 2300, training).unique(dim=0, return_counts=True)
        assert sorted(times.unique().tolist()) == [2, 3]
        assert sample_points(points[:0], 400, training).shape == (0, 4)
        assert sample_points(points[:1], 5, training).tolist() == points[:1].tolist() * 5
    assert torch.equal(sample_points(points, 1000, False), points)
    assert torch.equal(sample_points(points, 400, False), sample_points(points, 400, False))
    assert not torch.equal(sample_points(points, 1000, True), points)
    assert not torch.equal(sample_points(points, 400, True), sample_points(points, 400, True))
