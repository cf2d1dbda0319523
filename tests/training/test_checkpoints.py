"""Weights from files: what is loaded, converted, kept fresh, and every refusal."""

import collections
import copy
import struct
import zipfile

import pytest
import torch
from torch import nn

from lidarplace.base.errors import InputError
from tests.refused import refused
from training import build_detector
from training.checkpoints import DamagedCheckpoint, load_checkpoint, write_checkpoint
from training.detectors.detector import Detector, Selection


class Sparse(Detector):
    """Sparse convolutions of which one has as many inputs as outputs, and a head."""

    def __init__(self, classes=("Car",), inputs=4):
        super().__init__(classes, (0, 0, 0, 1, 1, 1), 0.0, Selection())
        self.first = nn.Module()
        self.first.weight = nn.Parameter(torch.randn(8, 3, 1, 1, inputs))
        self.second = nn.Module()
        self.second.weight = nn.Parameter(torch.randn(8, 3, 3, 3, 8))
        self.dense_head = nn.Linear(8, len(classes))

    def loss(self, points, boxes, labels):
        raise NotImplementedError

    def predict(self, points, selection=None):
        raise NotImplementedError


def write(path, content):
    torch.save(content, path)
    return path


def same(a, b):
    return all(torch.equal(value, b[key]) for key, value in a.items())


def assert_refused(content, key, expected, found, folder, **how):
    """The file is one line's error, and the model stays."""
    target, path = Sparse(), write(folder / "odd.pt", content)
    before = copy.deepcopy(target.state_dict())
    with pytest.raises(InputError, match=r"^[^\n]+$") as error:
        load_checkpoint(target, path, **how)
    refusal = error.value
    assert (refusal.place, refusal.key, refusal.expected) == (str(path), key, expected)
    assert refusal.found.endswith(found)
    assert same(before, target.state_dict())


def test_a_checkpoint_of_ours_comes_back(tmp_path):
    torch.manual_seed(0)
    source, target = (build_detector("pointpillars_tiny", ["Car", "Pedestrian"]) for _ in range(2))
    source.global_step += 7
    write_checkpoint(tmp_path / "base.pt", source.state_dict(), "pointpillars_tiny", source.classes)
    assert [path.name for path in tmp_path.iterdir()] == ["base.pt"]
    content = torch.load(tmp_path / "base.pt", weights_only=True)
    assert content["detector"] == "pointpillars_tiny"
    assert content["classes"] == ["Car", "Pedestrian"]
    report = load_checkpoint(target, tmp_path / "base.pt")
    assert report.reinitialised == ()
    assert same(source.state_dict(), target.state_dict())


@pytest.mark.parametrize("bare", [True, False])
def test_openpcdets_checkpoint_and_a_bare_state_dict(tmp_path, bare):
    source, target = Sparse(), Sparse()
    state = source.state_dict()
    optimizer = {"state": {}, "param_groups": [{"lr": 1e-7, "betas": (0.95, 0.99)}]}
    openpcdet = {"epoch": 80, "model_state": state, "optimizer_state": optimizer, "version": "0.5"}
    load_checkpoint(target, write(tmp_path / "file.pth", state if bare else openpcdet))
    assert same(state, target.state_dict())


@pytest.mark.parametrize("axes", [(1, 2, 3, 4, 0), (1, 2, 3, 0, 4)])
def test_layouts_of_spconv_1(tmp_path, axes):
    """Also of the convolution whose shape does not show the layout."""
    source, target = Sparse(), Sparse()
    old = {
        key: value.permute(axes).contiguous() if value.ndim == 5 else value
        for key, value in source.state_dict().items()
    }
    load_checkpoint(target, write(tmp_path / "old.pth", {"model_state": old}))
    assert same(source.state_dict(), target.state_dict())


def test_heads_for_other_classes_stay_fresh_only_when_asked(tmp_path):
    torch.manual_seed(0)
    source = build_detector("pointpillars_tiny", ["Car", "Pedestrian", "Cyclist"])
    target = build_detector("pointpillars_tiny", ["Car"])
    path = tmp_path / "base.pt"
    write_checkpoint(path, source.state_dict(), "pointpillars_tiny", source.classes)
    before = copy.deepcopy(target.state_dict())
    shapes = r"expected \[2, 64, 1, 1\], .*, found \[18, 64, 1, 1\], .*; new_heads"
    with refused(rf"dense_head\.conv_cls\.weight, .*; {shapes}"):
        load_checkpoint(target, path)
    assert same(before, target.state_dict())
    report = load_checkpoint(target, path, new_heads=True)
    heads = [key for key in before if key.startswith("dense_head.")]
    assert report.reinitialised == tuple(heads)
    after = target.state_dict()
    assert same({key: before[key] for key in heads}, after)
    rest = {key: value for key, value in source.state_dict().items() if key not in heads}
    assert same(rest, after)


def test_a_file_that_names_no_classes_has_openpcdets_order(tmp_path):
    kitti, sorted_by_name = ("Car", "Pedestrian", "Cyclist"), ("Car", "Cyclist", "Pedestrian")
    path = write(tmp_path / "pv_rcnn_8369.pth", {"model_state": Sparse(kitti).state_dict()})
    assert not load_checkpoint(Sparse(kitti), path).reinitialised
    with refused(("pv_rcnn_8369.pth", "classes", "OpenPCDet")):
        load_checkpoint(Sparse(sorted_by_name), path)
    report = load_checkpoint(Sparse(sorted_by_name), path, new_heads=True)
    assert report.reinitialised == ("dense_head.weight", "dense_head.bias")


def test_as_many_other_classes_are_other_classes(tmp_path):
    source, target = Sparse(["Car", "Pedestrian"]), Sparse(["Pedestrian", "Car"])
    path = tmp_path / "base.pt"
    write_checkpoint(path, source.state_dict(), "sparse", source.classes)
    with refused(r": classes: expected \['Pedestrian', 'Car'\], found \['Car', 'Pedestrian'\]; "):
        load_checkpoint(target, path)
    many = {"model_state": source.state_dict(), "classes": ["Car"] * 1000}
    with refused(r"found \[.{,60}'Car', \.\.\.\]; .{,200}$"):
        load_checkpoint(target, write(tmp_path / "many.pt", many))
    report = load_checkpoint(target, path, new_heads=True)
    assert report.reinitialised == ("dense_head.weight", "dense_head.bias")
    assert torch.equal(source.first.weight, target.first.weight)
    assert not torch.equal(source.dense_head.weight, target.dense_head.weight)


def test_entries_that_do_not_fit_are_named(tmp_path):
    state = Sparse().state_dict()
    nan = state | {"dense_head.bias": torch.tensor([torch.nan])}
    assert_refused(nan, "dense_head.bias", "finite numbers", "", tmp_path)
    state["third.weight"] = torch.zeros(2)
    del state["second.weight"]
    names = "5: 1 missing (second.weight), 1 unexpected (third.weight)"
    assert_refused(state, "", "5 entries", names, tmp_path, new_heads=True)
    other = build_detector("pointpillars_tiny", ["Car"]).state_dict()
    assert_refused(other, "", "5 entries", " more)", tmp_path)
    shapes, wider = ("[8, 3, 1, 1, 4]", "[8, 3, 1, 1, 5]"), Sparse(inputs=5).state_dict()
    assert_refused(wider, "first.weight", *shapes, tmp_path, new_heads=True)


class Planted:
    """Would run code if it were unpickled."""

    def __reduce__(self):
        return collections.deque, ([1, 2],)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ({"weight": torch.zeros(1), "extra": Planted()}, "tensors and plain values"),
        ([torch.zeros(1)], "a dict"),
        ({"model_state": 3}, "a state_dict of tensors"),
        ({}, "a state_dict of tensors"),
        ({"epoch": 3}, "a state_dict of tensors"),
    ],
)
def test_files_that_hold_something_else(tmp_path, content, expected):
    assert_refused(content, "", expected, "", tmp_path)


def test_damaged_files(tmp_path):
    path = write(tmp_path / "a.pth", Sparse().state_dict())
    whole = path.read_bytes()
    for content in (whole[: len(whole) // 2], b"", b"epoch,loss\n1,0.5\n", whole[:10]):
        path.write_bytes(content)
        with refused(("a.pth", "", "")):
            load_checkpoint(Sparse(), path)
    with pytest.raises(FileNotFoundError, match=r"none\.pth"):
        load_checkpoint(Sparse(), tmp_path / "none.pth")


def test_what_is_larger_than_the_file_is_not_unpacked(tmp_path, monkeypatch):
    path, bomb = write(tmp_path / "a.pth", Sparse().state_dict()), tmp_path / "bomb.pth"
    with zipfile.ZipFile(path) as whole, zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as packed:
        for entry in whole.infolist():
            packed.writestr(entry.filename, whole.read(entry))
        packed.writestr("a/data/999", bytes(10**6))
    monkeypatch.setattr(zipfile.ZipFile, "testzip", pytest.fail)
    monkeypatch.setattr(torch, "load", pytest.fail)
    with refused(("bomb.pth", "", f" bytes in a file of {bomb.stat().st_size:,}")):
        load_checkpoint(Sparse(), bomb)


def test_one_changed_bit_of_a_tensor_is_a_damage(tmp_path):
    path = write(tmp_path / "a.pth", Sparse().state_dict())
    whole = path.read_bytes()
    with zipfile.ZipFile(path) as archive:
        starts = [info.header_offset for info in archive.infolist() if "/data/" in info.filename]
    # A header has 30 bytes, then the name and what fills up, whose lengths stand in it.
    lengths = [struct.unpack_from("<HH", whole, start + 26) for start in starts]
    places = [start + 30 + sum(more) for start, more in zip(starts, lengths, strict=True)]
    assert places
    for place in places:
        data = bytearray(whole)
        data[place] ^= 1
        path.write_bytes(data)
        with pytest.raises(DamagedCheckpoint) as error:
            load_checkpoint(Sparse(), path)
        assert error.value.place == str(path)


@pytest.mark.parametrize("zipped", [True, False])
@pytest.mark.parametrize("protocol", [2, 3, 4, 5])
def test_pickle_protocols(tmp_path, protocol, zipped, recwarn):
    path, model = tmp_path / "a.pth", Sparse()
    state = Sparse().state_dict()
    torch.save(state, path, pickle_protocol=protocol, _use_new_zipfile_serialization=zipped)
    if protocol < 4:
        load_checkpoint(model, path)
        assert same(model.state_dict(), state)
    else:
        with refused(("a.pth", "", f"pickle protocol {protocol}")):
            load_checkpoint(model, path)
    assert not recwarn.list


WAYS = {
    "torch.int8": lambda t: t.to(torch.int8),
    "torch.bool": lambda t: t.to(torch.bool),
    "torch.complex64": lambda t: t.to(torch.complex64),
    "torch.qint8": lambda t: torch.quantize_per_tensor(t, 0.1, 0, torch.qint8),
    "torch.float32, torch.sparse_coo": lambda t: t.to_sparse(),
    "torch.float32 without data": lambda t: t.to("meta"),
    "torch.float32 with fewer numbers than its shape says": lambda t: torch.zeros(1).expand(
        10**5, 10**9
    ),
}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", WAYS)
def test_numbers_of_another_kind_are_refused(tmp_path, kind):
    state = Sparse().state_dict()
    state["dense_head.weight"] = WAYS[kind](state["dense_head.weight"])
    assert_refused(state, "dense_head.weight", "a dense tensor of floats", kind, tmp_path)


@pytest.mark.parametrize("kind", [torch.float16, torch.bfloat16, torch.float64])
def test_floats_of_other_widths_are_taken(tmp_path, kind):
    state, target = Sparse().state_dict(), Sparse()
    changed = {k: v.to(kind) if v.is_floating_point() else v for k, v in state.items()}
    load_checkpoint(target, write(tmp_path / "half.pt", changed))
    for key, value in target.state_dict().items():
        torch.testing.assert_close(value, state[key], rtol=1e-2, atol=0)
