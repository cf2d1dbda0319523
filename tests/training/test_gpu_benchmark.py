"""The benchmark of GPUs in its smallest form, and that grouped trainings compute the same."""

import json
import sys
from importlib import import_module
from pathlib import Path

import pytest
import torch
from typer import Typer
from typer.testing import CliRunner

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture(autouse=True)
def from_its_folder(monkeypatch):
    """Scripts import their neighbours by name."""
    monkeypatch.syspath_prepend(BENCHMARKS)
    monkeypatch.setenv("NUMBA_NUM_THREADS", "1")
    yield
    for name in [name for name in sys.modules if name.split("_")[0] == "gpu"]:
        del sys.modules[name]


def test_grouped_networks_have_the_losses_and_gradients_of_single_ones(one_thread):
    many = import_module("gpu_many")
    dense = [many.Dense(model) for model in many.networks(3, "cpu")]
    images = torch.rand(3, 2, 16, 20, 12)
    gradients, losses = many.grouped(dense, images)()
    expected = many.one_by_one(dense, images)
    assert len(set(expected.tolist())) == 3
    torch.testing.assert_close(losses, expected)
    for index, model in enumerate(dense):
        for name, weight in model.named_parameters():
            torch.testing.assert_close(gradients[name][index], weight.grad, rtol=1e-4, atol=1e-6)


def test_rates_of_trainings(one_thread):
    row = import_module("gpu_many").measure_trainings(1, "cpu", 0.01)
    assert row["trainings"] == 1
    assert len(row) == 5
    assert min(row.values()) > 0


@pytest.fixture
def gpu(monkeypatch):
    """The command, whose networks do one step, in this process."""
    command = import_module("gpu")
    networks = import_module("gpu_networks")
    monkeypatch.setattr(networks, "STEPS", 1)
    monkeypatch.setattr(networks, "WARM_UP", 0)
    monkeypatch.setattr(command, "in_process", lambda _, measure, *values: measure(*values))
    return command


def run(command, folder, *options):
    app = Typer()
    app.command()(command.main)
    return CliRunner().invoke(app, [f"--out={folder}", "--device=cpu", "--preset=tiny", *options])


def test_a_table_and_numbers_of_networks(gpu, tmp_path):
    done = run(gpu, tmp_path, "--only=networks", "--network=pointpillars:1")
    assert done.exit_code == 0, done.output
    text, numbers = (
        (tmp_path / "gpu.md").read_text(),
        json.loads((tmp_path / "gpu.json").read_text()),
    )
    assert text.strip() in done.output
    row = numbers["networks"][0]
    assert row["train (ms)"] > 0
    assert f"| pointpillars | 1 | {row['parameters']:,} |" in text
    places = [place for place, _, _ in row["train: profile"]["dearest"]]
    assert len(places) == 10
    assert any("convolution" in place for place in places)
    assert numbers["machine"]["torch"] == torch.__version__


def test_a_table_of_operations(gpu, tmp_path):
    done = run(gpu, tmp_path, "--only=operations")
    assert done.exit_code == 0, done.output
    rows = json.loads((tmp_path / "gpu.json").read_text())["operations"]
    assert len(rows) > 12
    assert all(row["cpu"] > 0 for row in rows)


def test_a_section_that_fails_does_not_stop_the_next(gpu, tmp_path, monkeypatch):
    def fail(*_):
        raise RuntimeError("CUDA error:\nan illegal memory access")

    monkeypatch.setattr(gpu.gpu_operations, "measure", fail)
    rows = [{"device": "cpu", "a rig (s)": 0.1}]
    monkeypatch.setattr(gpu.gpu_many, "measure_rigs", lambda *_: rows)
    done = run(gpu, tmp_path, "--only=operations", "--only=rigs")
    assert done.exit_code == 1
    assert "RuntimeError: CUDA error: an illegal memory access" in (tmp_path / "gpu.md").read_text()
    assert json.loads((tmp_path / "gpu.json").read_text())["rigs"] == rows


def test_no_measurement_begins_when_the_time_is_over(tmp_path):
    done = run(import_module("gpu"), tmp_path, "--only=trainings", "--minutes=0")
    assert done.exit_code == 1
    assert "TimeoutError: not run: the time is over" in done.output
