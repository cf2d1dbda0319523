"""A detector is two files, as docs/extending.md has them."""

from sweeps.tasks.task import code_of
from tests.extending import blocks_of, check_layers, copy_tree, put, python

USE = """
import torch

from sweeps.configuration.sweep import Point
from sweeps.tasks.task import code_of
from training import build_detector

Point.model_validate({"placement": "line", "detector": "second_wide_tiny"})
torch.manual_seed(0)
wide, narrow = (build_detector(name, ["Car"]) for name in ("second_wide_tiny", "second_tiny"))
print(sum(p.numel() for p in wide.parameters()) > sum(p.numel() for p in narrow.parameters()))
points = torch.rand(2000, 4) * torch.tensor([10.0, 4.0, 2.0, 1.0])
box = torch.tensor([[5.0, 2.0, 0.8, 4.0, 2.0, 1.6, 0.0]])
wide.loss([points], [box], [torch.tensor([1])])["loss"].backward()
print(all(p.grad is not None and p.grad.isfinite().all() for p in wide.parameters()))
print(sorted(wide.predict([points])[0]))
print(code_of("finetune", "second_tiny"), code_of("evaluate", "pv_rcnn"))
print(code_of("finetune", "second_wide_tiny") != code_of("finetune", "second_tiny"))
"""


def test_a_detector_is_two_files(tmp_path):
    tree = copy_tree(tmp_path)
    network, name = blocks_of("A detector")
    (tree / "training/detectors/second_wide.py").write_text(network, encoding="utf-8")
    put(tree / "training/__init__.py", ')\n"""The networks; ', name)
    larger, learns, found, others, another = python(tree, "-c", USE).splitlines()
    assert (larger, learns, another) == ("True", "True", "True")
    assert found == "['boxes', 'labels', 'scores']"
    # What the store has of other detectors stays.
    assert others == f"{code_of('finetune', 'second_tiny')} {code_of('evaluate', 'pv_rcnn')}"
    check_layers(tree)
