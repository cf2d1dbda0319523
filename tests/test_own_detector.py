"""`examples/own_detector`: a network from outside trains, resumes, and wraps those of others."""

import shutil
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import torch
import yaml
from torch import nn

from lidarplace.base.code_version import code_version, forget_versions
from lidarplace.base.errors import InputError
from lidarplace.base.plugin_folders import PLUGINS, plugin_folder
from sweeps.execution.failures import Failure
from sweeps.execution.ray_cluster import _plug_ins
from tests.docs_blocks import ROOT
from tests.extending import install
from tests.forked import GUARD_S, Forked, run_forked
from tests.mlflow_database import write_database
from tests.sweeps.small_log import SMALL, write_small_log
from training import build_detector, code_of_network, network_of
from training.detectors.contract import as_arrays, checked_losses
from training.detectors.detector import Detector

EXAMPLE = ROOT / "examples/own_detector"
NETWORK = "own_detector.nets:build"
BOX = torch.tensor([[5.0, 2.0, 0.8, 4.0, 2.0, 1.6, 0.5]])
RANGE = (0.0, -20.0, 0.0, 40.0, 20.0, 4.0)


@pytest.fixture
def plugins():
    """Plug-ins of a new process: none was loaded."""
    modules = set(sys.modules)
    PLUGINS.clear()
    yield PLUGINS
    PLUGINS.clear()
    for name in set(sys.modules) - modules:
        if name.partition(".")[0] in ("own_detector", "broken"):
            del sys.modules[name]
    forget_versions()


@pytest.fixture
def example(plugins, monkeypatch):
    """The example's package, as `PYTHONPATH` has it."""
    monkeypatch.syspath_prepend(str(EXAMPLE))


def write_sweep(folder):
    """A project whose network is next to its configuration, not in the current folder."""
    write_small_log(folder / "log")
    write_database(folder / "runs/mlflow.db")
    shutil.copytree(EXAMPLE, folder / "project", ignore=shutil.ignore_patterns("__pycache__"))
    settings = {"detector": NETWORK, "training": {"epochs": 4, "batch_size": 1}}
    settings |= {"lidar": {"beams": 8, "azimuth_steps": 90}, "grid": {"placement": ["line"]}}
    (folder / "project/sweep.yaml").write_text(yaml.safe_dump(SMALL | settings))


def test_a_sweep_trains_it_and_logs_a_model(tmp_path):
    write_sweep(tmp_path)
    run, log = ["run", "project/sweep.yaml", "--set", "training.epochs=1"], tmp_path / "out.log"
    assert Forked(run, tmp_path, log).wait(GUARD_S) == 0, log.read_text()
    assert "MLflow refuses" not in log.read_text()


@pytest.mark.usefixtures("one_thread")
def test_it_learns(example):
    torch.manual_seed(0)
    model = build_detector(NETWORK, ["Car"], point_range=(0.0, -4.0, 0.0, 12.0, 8.0, 4.0))
    points = torch.rand(300, 4) * torch.tensor([4.0, 2.0, 1.6, 0.0]) + torch.tensor([3, 1, 0, 0.5])
    optimiser = torch.optim.Adam(model.parameters(), 0.01)
    for step in range(100):
        optimiser.param_groups[0]["lr"] = 0.01 if step < 60 else 0.001
        loss = model.loss([points], [BOX], [torch.ones(1, dtype=torch.int64)])["loss"]
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    with torch.no_grad():
        (detected,) = as_arrays(model.eval(), model.predict([points]), [0])
    assert np.allclose(detected["boxes"][0], BOX.numpy(), atol=0.2)
    assert detected["labels"][0] == 1


def test_installed_it_has_a_name(tmp_path):
    package = shutil.copytree(EXAMPLE, tmp_path / "package")  # pip writes into it
    site = install(package, tmp_path / "site")
    use = "from training import build_detector; print(build_detector('centre_net_tiny', ['Car']))"
    result = run_forked(["-c", use], tmp_path, tmp_path, site=site)
    assert "heat_head" in result.stdout, result.stderr


def test_its_code_reaches_workers_and_keys(plugins, tmp_path):
    shutil.copytree(EXAMPLE / "own_detector", tmp_path / "own_detector")
    with plugin_folder(tmp_path):
        build_detector(NETWORK, ["Car"])
    assert _plug_ins() == [str(tmp_path / "own_detector")]
    assert network_of(f"{NETWORK}_tiny") == NETWORK
    code = code_version(*code_of_network(NETWORK))
    text = (tmp_path / "own_detector/nets.py").read_text()
    (tmp_path / "own_detector/nets.py").write_text(text.replace("SPREAD = 1.5", "SPREAD = 1.6"))
    forget_versions()
    assert code_version(*code_of_network(NETWORK)) != code


BROKEN = """
from training.detectors.detector import Detector

class Net(Detector):
    def loss(self, points, boxes, labels):
        return points["x"]

def build(classes, preset, point_range, typical):
    return Net(classes, (0, 0, 0, 1, 1, 1))

class Whole(Net):
    def predict(self, points, selection=None):
        return 1 / 0

def net_tiny(classes, preset, point_range, typical):
    return Whole(classes, (0, 0, 0, 1, 1, 1))

def three(classes, preset, point_range):
    pass

def none(*arguments):
    pass
"""


@pytest.fixture
def broken(plugins, tmp_path, monkeypatch):
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken/__init__.py").touch()
    (tmp_path / "broken/nets.py").write_text(BROKEN)
    (tmp_path / "broken/bad.py").write_text("import torch\nint('x')\n")
    monkeypatch.syspath_prepend(str(tmp_path))


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("nets:build", r"broken.nets:build: broken/nets.py:9: TypeError: .*abstract.* predict"),
        ("nets:three", r"broken.nets:three: TypeError: three\(\) takes 3 .* but 4 were given"),
        ("nets:none", r"broken.nets:none: wrong type; expected a Detector, .*, found NoneType"),
        ("bad:build", r"broken.bad:build: cannot be imported: broken/bad.py:2: ValueError: inval"),
        ("nets:nothing", r"broken.nets:nothing: cannot be imported: AttributeError: module"),
    ],
)
def test_what_cannot_be_built_is_one_line(broken, name, problem):
    with pytest.raises(ValueError, match=problem):
        build_detector(f"broken.{name}", ["Car"])


def test_a_mistake_in_the_users_code_has_its_file_and_line(broken):
    model = build_detector("broken.nets:net_tiny", ["Car"])  # the whole name, not a preset
    for call, problem in (
        (lambda: model.predict([]), "broken/nets.py:13: ZeroDivisionError: division by zero"),
        (lambda: model.loss([], [], []), "broken/nets.py:6: TypeError: list indices must be"),
    ):
        with pytest.raises(Exception) as error:  # noqa: PT011 - of any kind
            call()
        assert Failure.of(error.value).reason.startswith(problem)


STRANGE = """: broken: :build broken.nets:build: broken.nets.py:build ../x:y é:ü broken.nets
broken:nets broken.nets:BROKEN broken.nets:build.x 1:2 json:loads math:sqrt builtins:dict
[red]:x"""


@pytest.mark.parametrize("name", ["", "a b:c", "x" * 3000 + ":y", "a\x00:b", *STRANGE.split()])
def test_a_name_that_is_no_network(broken, name):
    with pytest.raises(ValueError, match=r"^[^\n]+$"):
        build_detector(name, ["Car"])


class Returns(Detector):
    """A network that returns whatever it is given."""

    def __init__(self) -> None:
        super().__init__(["Car", "Cyclist"], RANGE)

    def loss(self, points, boxes, labels):
        raise NotImplementedError

    def predict(self, points, selection=None):
        raise NotImplementedError


ONE = torch.ones(1)


def test_parts_of_a_loss_may_be_plain_numbers():
    loss = torch.ones((), requires_grad=True)
    losses = checked_losses(Returns(), {"loss": loss, "box": 0.5, "count": 3})
    assert losses["box"] == 0.5
    assert losses["count"].is_floating_point()


def detections(**changed):
    return {"boxes": BOX, "scores": ONE, "labels": ONE.long()} | changed


def test_an_empty_frame_is_a_frame():
    none = detections(boxes=BOX[:0], scores=ONE[:0], labels=ONE[:0].long())
    (arrays,) = as_arrays(Returns(), [none], [7])
    assert arrays["boxes"].shape == (0, 7)


POINTS = [torch.rand(5, 4), torch.rand(3, 4)]
BOXES = [torch.cat([BOX, BOX + 1]), BOX[:0]]
LABELS = [torch.tensor([2, 1]), torch.zeros(0, dtype=torch.int64)]


class Dataset:
    """OpenPCDet's DatasetTemplate, as far as it is used, for a network of points."""

    def __init__(self, dataset_cfg, class_names, training=True):
        assert not training, "augmentation is done"
        self.class_names = class_names
        self.point_cloud_range = np.array(dataset_cfg["POINT_CLOUD_RANGE"], np.float32)

    def prepare_data(self, data):
        if "gt_boxes" in data:
            labels = [[self.class_names.index(name) + 1] for name in data.pop("gt_names")]
            labels = np.array(labels, np.float32).reshape(-1, 1)
            data["gt_boxes"] = np.concatenate([data["gt_boxes"], labels], axis=1)
        return data | {"use_lead_xyz": True}

    @staticmethod
    def collate_batch(frames):
        points = [
            np.pad(frame["points"], ((0, 0), (1, 0)), constant_values=i)
            for i, frame in enumerate(frames)
        ]
        batch = {"points": np.concatenate(points), "batch_size": len(frames)}
        batch["frame_id"] = np.array([frame["frame_id"] for frame in frames])
        if "gt_boxes" in frames[0]:
            batch["gt_boxes"] = np.zeros((len(frames), 2, 8), np.float32)
            for padded, frame in zip(batch["gt_boxes"], frames, strict=True):
                padded[: len(frame["gt_boxes"])] = frame["gt_boxes"]
        return batch


class PcdetModel(nn.Module):
    """A model of OpenPCDet that predicts the objects of the last batch."""

    def __init__(self) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.ones(()))

    def forward(self, batch):
        points = batch["points"]
        assert points[:, 0].tolist() == [0] * 5 + [1] * 3
        assert points.dtype == torch.float32
        assert batch["batch_size"] == 2
        if self.training:
            self.objects = batch["gt_boxes"]
            loss = self.weight * points.sum()
            return {"loss": loss}, {"rpn_loss": 0.5, "text": "no number"}, {}
        return [
            {
                "pred_boxes": boxes[:, :7],
                "pred_scores": boxes[:, 7] / 2,
                "pred_labels": boxes[:, 7].int(),
            }
            for boxes in self.objects
        ], {"gt": 0}


def module(name, **content):
    made_module = ModuleType(name)
    vars(made_module).update(content)
    return made_module


def round_trip(name):
    """The losses of a wrapped model, and what it predicts: the objects it was trained on."""
    model = build_detector(name, ["Car", "Cyclist"]).train()
    losses = checked_losses(model, model.loss(POINTS, BOXES, LABELS))
    losses["loss"].backward()
    assert all(parameter.grad is not None for parameter in model.parameters())
    model.eval()
    return model, losses, as_arrays(model, model.predict(POINTS), [0, 1])


def test_a_model_of_openpcdet(example, monkeypatch):
    cfg = SimpleNamespace(
        CLASS_NAMES=["Car", "Cyclist"], DATA_CONFIG={"POINT_CLOUD_RANGE": RANGE}, MODEL="model"
    )
    for fake in (
        module("pcdet"),
        module("pcdet.config", cfg=cfg, cfg_from_yaml_file=lambda path, cfg: cfg),
        module("pcdet.datasets", DatasetTemplate=Dataset),
        module("pcdet.models", build_network=lambda model_cfg, num_class, dataset: PcdetModel()),
    ):
        monkeypatch.setitem(sys.modules, fake.__name__, fake)
    model, losses, detected = round_trip("own_detector.openpcdet:build")
    assert losses.keys() == {"loss", "rpn_loss"}
    assert model.point_range == RANGE
    assert np.allclose(detected[0]["boxes"], BOXES[0])
    assert detected[0]["labels"].tolist() == [2, 1]
    assert detected[0]["scores"].tolist() == [1, 0.5]
    assert len(detected[1]["boxes"]) == 0, "padding is no detection"
    with pytest.raises(InputError, match=r"openpcdet.py:\d+: ValueError: .*CLASS_NAMES"):
        build_detector("own_detector.openpcdet:build", ["Cyclist", "Car"])


class Instances(SimpleNamespace):
    """mmengine's InstanceData, and mmdet3d's Det3DDataSample."""


class LidarBoxes:
    """mmdet3d's LiDARInstance3DBoxes."""

    def __init__(self, tensor):
        assert tensor.shape[1] == 7
        self.tensor = tensor


class MmdetModel(nn.Module):
    """A model of MMDetection3D 1.x that predicts the objects of the last batch."""

    def __init__(self) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.ones(()))

    def data_preprocessor(self, data, training):
        return data | {"inputs": data["inputs"] | {"voxels": {}}}

    def loss(self, inputs, samples):
        assert "voxels" in inputs
        self.objects = [sample.gt_instances_3d for sample in samples]
        return {"loss_cls": [self.weight, self.weight], "loss_bbox": 2 * self.weight}

    def parse_losses(self, losses):
        parts = {"loss_cls": sum(losses["loss_cls"]), "loss_bbox": losses["loss_bbox"]}
        return sum(parts.values()), {"loss": sum(parts.values()), **parts}

    def predict(self, inputs, samples):
        assert all(sample.metainfo["box_type_3d"] is LidarBoxes for sample in samples)
        return [
            Instances(
                pred_instances_3d=Instances(
                    bboxes_3d=sample.bboxes_3d,
                    labels_3d=sample.labels_3d,
                    scores_3d=sample.labels_3d / 2 + 0.05,
                )
            )
            for sample in self.objects
        ]


def test_a_model_of_mmdetection3d(example, monkeypatch):
    config = SimpleNamespace(model="model", point_cloud_range=list(RANGE))
    structures = {"Det3DDataSample": Instances, "LiDARInstance3DBoxes": LidarBoxes}
    for fake in (
        module("mmdet3d"),
        module("mmdet3d.structures", **structures),
        module("mmdet3d.registry", MODELS=SimpleNamespace(build=lambda model: MmdetModel())),
        module("mmengine"),
        module("mmengine.config", Config=SimpleNamespace(fromfile=lambda path: config)),
        module("mmengine.registry", init_default_scope=lambda scope: None),
        module("mmengine.structures", InstanceData=Instances),
    ):
        monkeypatch.setitem(sys.modules, fake.__name__, fake)
    model, losses, detected = round_trip("own_detector.mmdetection3d:build")
    assert {name: value.item() for name, value in losses.items()} == {
        "loss": 4,
        "loss_cls": 2,
        "loss_bbox": 2,
    }
    assert model.model.objects[0].labels_3d.tolist() == [1, 0], "labels from 0"
    bottom = model.model.objects[0].bboxes_3d.tensor
    assert torch.allclose(bottom[:, 2], BOXES[0][:, 2] - BOXES[0][:, 5] / 2)
    assert np.allclose(detected[0]["boxes"], BOXES[0][:1], atol=1e-6), "a score of 0.05 is too low"
    assert detected[0]["labels"].tolist() == [2]
    assert len(detected[1]["boxes"]) == 0
