"""A training that was stopped goes on as if it had not been."""

import pytest
import torch

from tests.refused import refused
from tests.training.synthetic_scenes import scenes
from training.detectors.pointpillars import PointPillars
from training.finetune import TrainingContext, finetune
from training.settings import TrainingSettings

pytestmark = pytest.mark.usefixtures("one_thread")

SETTINGS = TrainingSettings(epochs=4, batch_size=2)


class Stop(Exception):
    """Stands for a process that is killed."""


@pytest.fixture(scope="module")
def data():
    return scenes(4, seed=1, classes=("Car", "Pedestrian"), fewest=3)


def train(data, folder=None, settings=SETTINGS, seed=3, stop=None, halvings=0):
    epochs = []

    def on_step(epochs_done):
        if stop and epochs_done > stop:
            raise Stop
        epochs.extend([int(epochs_done)] * epochs_done.is_integer())

    network = ("pointpillars_tiny", ["Pedestrian", "Car"])
    context = TrainingContext(folder=folder, on_step=on_step, halvings=halvings)
    return finetune(*network, *data, settings, seed, context), epochs


def losses(result):
    return result.curve[~result.curve.metric.isin(["seconds"])].reset_index(drop=True)


def same(one, other):
    assert losses(one).equals(losses(other))
    assert list(one.state_dict) == list(other.state_dict)
    assert all(torch.equal(one.state_dict[key], other.state_dict[key]) for key in one.state_dict)


@pytest.mark.parametrize("optimizer", ["adam_onecycle", "sgd"])
def test_a_stopped_training_gives_what_it_would_have_given(data, tmp_path, optimizer):
    settings = SETTINGS.model_copy(update={"optimizer": optimizer, "lr": 0.003})
    whole, epochs = train(data, settings=settings)
    assert epochs == [1, 2, 3, 4]
    for stop in (1, 3):
        with pytest.raises(Stop):
            train(data, tmp_path, settings, stop=stop)
        torch.manual_seed(stop)  # the process that goes on has another state
    rest, epochs = train(data, tmp_path, settings)
    assert epochs == [4]
    same(whole, rest)
    seconds = rest.curve[rest.curve.metric == "seconds"].set_index("epoch")["value"]
    assert rest.earlier_seconds == pytest.approx(seconds[:3].sum())
    assert whole.earlier_seconds == 0
    result, epochs = train(data, tmp_path, settings)
    assert epochs == []
    same(whole, result)
    assert result.curve.equals(rest.curve), "the seconds too"


def test_halved_steps_go_on_unless_they_are_still_too_large(data, tmp_path):
    settings = SETTINGS.model_copy(update={"batch_size": 4})
    with pytest.raises(Stop):
        train(data, tmp_path, settings, stop=2, halvings=1)
    result, epochs = train(data, tmp_path, settings, halvings=1)
    assert (epochs, result.batch_size, result.batch_size_reduced) == ([3, 4], 2, True)
    result, epochs = train(data, tmp_path, settings, halvings=2)
    assert (epochs, result.batch_size, result.batch_size_reduced) == ([1, 2, 3, 4], 1, True)


def test_another_training_does_not_go_on_here(data, tmp_path):
    train(data, tmp_path)
    clouds, truth = data
    moved = truth.assign(x=truth["x"] + 0.01)
    fewer = scenes(3, seed=1, classes=("Car", "Pedestrian"), fewest=3)[0]
    for kind in (
        {"settings": SETTINGS.model_copy(update={"lr": 0.02})},
        {"seed": 4},
        {"data": (clouds, moved)},
        {"data": (fewer, truth)},
    ):
        with refused(rf"^{tmp_path}/last\.pt: .*; remove it, or use another folder$"):
            train(**({"data": data, "folder": tmp_path} | kind))


@pytest.mark.parametrize("harm", ["empty", "half", "bit"])
def test_a_damaged_checkpoint_is_told_and_the_training_starts_again(data, tmp_path, caplog, harm):
    settings = SETTINGS.model_copy(update={"epochs": 2})
    whole, _ = train(data, tmp_path, settings)
    path = tmp_path / "last.pt"
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes({"bit": content, "half": content[:5000], "empty": b""}[harm])
    again, epochs = train(data, tmp_path, settings)
    assert epochs == [1, 2]
    same(whole, again)
    assert "last.pt" in caplog.text


@pytest.mark.parametrize("content", [[1, 2], "weights", b"not a file of torch"])
def test_a_file_of_something_else_is_an_error(data, tmp_path, content):
    if isinstance(content, bytes):
        (tmp_path / "last.pt").write_bytes(content)
    else:
        torch.save(content, tmp_path / "last.pt")
    with refused(rf"^{tmp_path}/last\.pt: .*; remove it to start again$"):
        train(data, tmp_path)


def test_random_numbers_of_the_network_follow_from_the_seed(data, tmp_path, monkeypatch):
    """Two-stage detectors draw boxes from torch's generator in training."""
    loss = PointPillars.loss

    def noisy(self, *batch):
        parts = loss(self, *batch)
        return parts | {"loss": parts["loss"] * (1 + torch.rand(()).item())}

    monkeypatch.setattr(PointPillars, "loss", noisy)
    torch.manual_seed(5)
    state = torch.get_rng_state()
    whole, _ = train(data)
    assert torch.equal(torch.get_rng_state(), state)
    with pytest.raises(Stop):
        train(data, tmp_path, stop=2)
    torch.manual_seed(6)
    same(whole, train(data, tmp_path)[0])
    assert not losses(whole).equals(losses(train(data, seed=9)[0]))
