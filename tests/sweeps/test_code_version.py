"""Which edits change the version of the code that a stage or a kernel can run, and which do not."""

import shutil
from pathlib import Path

import pytest

from lidarplace.base.code_version import PACKAGES, Sources
from tests.refused import refused
from tests.stage_names import stage_modules

ROOT = Path(__file__).parents[2]

TOY = {
    "app/__init__.py": "from app.kernels import cast\nfrom app.figures import draw\n",
    "app/stages.py": """
from typing import TYPE_CHECKING

from app import cast
from app.models import Settings

if TYPE_CHECKING:
    from app.figures import draw

def train(params):
    from app.optimiser import step
    return step(Settings(**params)), cast(3)
""",
    "app/kernels.py": """
import numpy as np
from numba import njit

NEAR = 0.1
FAR = 100.0

@njit
def cast(n):
    return bounce(n - 1) if n else NEAR + np.sum(n)

@njit
def bounce(n):
    return cast(n)

def far():
    return FAR
""",
    "app/models.py": """
from dataclasses import dataclass
from pydantic import Field
from app.units import Metres

@dataclass
class Settings:
    size: Metres = Field(1.0, description='m')

    def area(self):
        return squared(self.size)

def squared(x):
    return x * x
""",
    "app/units.py": "Metres = float\nSeconds = float\n",
    "app/optimiser.py": """
import torch
torch.set_num_threads(1)
RATE = {}
RATE["lr"] = 0.1
LOG = []
LOG.append("")

def step(settings):
    return settings.area() * RATE["lr"]
""",
    "app/figures.py": "def draw(params):\n    return params\n",
}


def version(folder, *changes, roots=("app.stages",), files=TOY):
    """Version of the toy after edits (file, old, new)."""
    files = dict(files)
    for name, old, new in changes:
        assert old in files[name]
        files[name] = files[name].replace(old, new)
    shutil.rmtree(folder / "app", ignore_errors=True)
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return Sources({"app": folder / "app"}).version(*roots)


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("app/kernels.py", "NEAR = 0.1", "# how near\nNEAR = 0.1  # metres\n'''Metres.'''"),
        ("app/kernels.py", "def cast(n):", "def cast(n: int) -> float:\n    '''Casts.'''"),
        ("app/models.py", "class Settings:", "class Settings:\n    '''Sizes.'''\n"),
        ("app/models.py", "description='m'", "description='metres'"),
        ("app/optimiser.py", "RATE = {}", "RATE: dict[str, float] = {}"),
        ("app/figures.py", "return params", "return 2 * params"),
        ("app/__init__.py", "import draw", "import draw as paint"),
        ("app/stages.py", "import draw", "import draw as paint"),
    ],
)
def test_what_cannot_change_the_result_does_not_count(tmp_path, file, old, new):
    assert version(tmp_path, (file, old, new)) == version(tmp_path)


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("app/kernels.py", "NEAR = 0.1", "NEAR = 0.2"),
        ("app/kernels.py", "return cast(n)", "return cast(n + 1)"),
        ("app/kernels.py", "import numpy as np", "import torch as np"),
        ("app/kernels.py", "@njit\ndef bounce", "@njit(fastmath=True)\ndef bounce"),
        ("app/models.py", "size: Metres", "size: int"),
        ("app/units.py", "Metres = float", "Metres = int"),
        ("app/models.py", "return x * x", "return x * x * x"),
        ("app/optimiser.py", "torch.set_num_threads(1)", "torch.set_num_threads(2)"),
        ("app/optimiser.py", 'RATE["lr"] = 0.1', 'RATE["lr"] = 0.2'),
        ("app/stages.py", "cast(3)", "cast(4)"),
        ("app/stages.py", "cast(3)", "cast(3.0)"),
    ],
)
def test_what_can_change_the_result_counts(tmp_path, file, old, new):
    assert version(tmp_path, (file, old, new)) != version(tmp_path)


def test_relative_imports_are_followed(tmp_path):
    files = {
        "app/__init__.py": "",
        "app/go.py": "from . import near\nfrom .inner.far import FAR\n",
        "app/near.py": "NEAR = 1\n",
        "app/inner/__init__.py": "",
        "app/inner/far.py": "from ..unit import UNIT\nFAR = 2 * UNIT\n",
        "app/unit.py": "UNIT = 1\n",
    }
    before = version(tmp_path, roots=["app.go"], files=files)
    for file, old in (("app/near.py", "1"), ("app/inner/far.py", "2"), ("app/unit.py", "1")):
        assert version(tmp_path, (file, old, "9"), roots=["app.go"], files=files) != before


@pytest.mark.parametrize(
    ("roots", "counts"), [((), True), (("app.nets.one",), False), (("app.nets.two",), True)]
)
def test_modules_imported_by_name_count_all_unless_a_root_says_which(tmp_path, roots, counts):
    files = {
        "app/__init__.py": "",
        "app/go.py": "import importlib\n"
        "def run(name):\n    return importlib.import_module(f'app.nets.{name}').build()\n",
        "app/nets/__init__.py": "",
        "app/nets/one.py": "def build():\n    return 1\n",
        "app/nets/two.py": "def build():\n    return 2\n",
    }
    roots = ("app.go", *roots)
    change = ("app/nets/two.py", "return 2", "return 3")
    before = version(tmp_path, roots=roots, files=files)
    assert (version(tmp_path, change, roots=roots, files=files) != before) == counts


@pytest.mark.parametrize(
    "call", ["import_module(name)", "__import__(name)", "import_module('app.' + name)"]
)
def test_an_import_that_cannot_be_followed_is_refused(tmp_path, call):
    code = f"from importlib import import_module\ndef run(name):\n    return {call}\n"
    with refused(("go.py", "line 3", "")):
        version(tmp_path, roots=["app.go"], files={"app/__init__.py": "", "app/go.py": code})


@pytest.mark.parametrize("root", ["app.nothing", "other.train"])
def test_a_root_that_leads_nowhere_is_refused(tmp_path, root):
    with refused((root, "", "")):
        version(tmp_path, roots=[root])


# The project itself


def versions(folder):
    """Versions of the code of all stages, with one network and simulated traffic."""
    sources = Sources({name: folder / name for name in PACKAGES})
    further = {"scene": ["lidarplace.scenes.sumo.record"]}
    further |= {name: ["training.detectors.pointpillars"] for name in ("train", "evaluate")}
    return {
        name: sources.version(module, *further.get(name, []))
        for name, module in stage_modules().items()
    }


@pytest.fixture(scope="module")
def before():
    return versions(ROOT)


@pytest.fixture
def copied(tmp_path):
    for name in PACKAGES:
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def test_comments_figures_converters_and_the_command_line_leave_stages_as_they_are(copied, before):
    for path in copied.rglob("*.py"):
        path.write_text(f'{path.read_text()}\n# a comment\n"""A docstring."""\n')
    spared = ["viewing/*.py", "**/nuscenes.py", "**/argoverse.py", "commands/*.py"]
    paths = [path for spare in spared for path in (copied / "lidarplace").glob(spare)]
    assert len(paths) > 5
    for path in paths + list((copied / "tracking").rglob("*.py")):
        path.write_text(f"{path.read_text()}\nANOTHER = 1\n")
    now = versions(copied)
    # A command reads and writes the layouts of these data sets; no other stage does.
    assert {name for name in now if now[name] != before[name]} == {"command"}


TRAINED = {"train", "evaluate"}
"""Modules of stages that import networks; commands and what measures them do not."""
CASES = [
    ("lidarplace/coverage/cone_sines.py", {"surrogates", "accuracy", "sampling_error"}),
    ("lidarplace/clouds/returns.py", {"collect", *TRAINED}),
    ("training/ops/rotated_iou.py", TRAINED),
    ("training/ops/gpu/rotated_iou.py", TRAINED),
    ("training/detectors/pointpillars.py", TRAINED),
    ("training/detectors/second.py", set()),
    ("lidarplace/scenes/sumo/record.py", {"scene"}),
]


@pytest.mark.parametrize(("path", "stages"), CASES, ids=[path for path, _ in CASES])
def test_an_inner_constant_counts_where_it_can_run(copied, before, path, stages):
    file = copied / path
    file.write_text(f"{file.read_text()}\nANOTHER = 1\n")
    after = versions(copied)
    changed = {name for name in after if after[name] != before[name]}
    assert changed >= stages
    assert not (path.startswith("training/detectors") and changed & {"command", "measure"})
