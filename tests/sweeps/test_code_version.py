"""Which edits change the version of the code that a function can run, and which do not."""

import shutil
from copy import copy
from pathlib import Path

import pytest

from sweeps import PACKAGES
from sweeps.tasks.code_version import Code
from sweeps.tasks.source import read_source
from sweeps.tasks.stages import FUNCTIONS
from tests.refused import refused

ROOT = Path(__file__).parents[2]
TRAINED = ("pretrain", "finetune", "evaluate", "judge")
OWN = {"scene": "lidarplace.scenes.sumo.record.TownRecording"} | dict.fromkeys(
    TRAINED, "training.detectors.pointpillars"
)
"""Of networks and kinds of scenes the one that a stage has."""

TOY = {
    "app/__init__.py": "",
    "app/stages.py": """
from app.kernels import cast
from app.models import Settings

def train(params):
    from app.optimiser import step
    return step(Settings(**params)), cast(3)

def look(params):
    from app.figures import draw
    return draw(params)
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
from app.units import Metres

@dataclass
class Settings:
    size: Metres = 1.0

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


def code_of(folder, files):
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return Code({"app": folder / "app"})


def version(folder, changes=(), root="app.stages.train"):
    """Version of the toy after edits (file, old, new)."""
    files = dict(TOY)
    for name, old, new in changes:
        assert old in files[name]
        files[name] = files[name].replace(old, new)
    shutil.rmtree(folder / "app", ignore_errors=True)
    return code_of(folder, files).version(root)


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("app/kernels.py", "NEAR = 0.1", "# how near\nNEAR = 0.1  # metres\n'''Metres.'''"),
        ("app/kernels.py", "def cast(n):", "def cast(n: int) -> float:\n    '''Casts.'''"),
        ("app/models.py", "class Settings:", "class Settings:\n    '''Sizes.'''\n"),
        ("app/optimiser.py", "RATE = {}", "RATE: dict[str, float] = {}"),
        ("app/kernels.py", "FAR = 100.0", "FAR = 99.0"),
        ("app/kernels.py", "return FAR", "return FAR + 1"),
        ("app/units.py", "Seconds = float", "Seconds = int"),
        ("app/figures.py", "return params", "return 2 * params"),
        ("app/optimiser.py", 'LOG.append("")', 'LOG.append("x")'),
        ("app/stages.py", "return draw(params)", "return draw(3)"),
        (
            "app/models.py",
            "    def area",
            "    def plot(self):\n        from app.figures import draw\n"
            "        return draw(self)\n\n"
            "    def __repr__(self):\n        return FAR\n\n    def area",
        ),
    ],
)
def test_what_cannot_change_the_result_does_not_count(tmp_path, file, old, new):
    assert version(tmp_path, [(file, old, new)]) == version(tmp_path)


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
    assert version(tmp_path, [(file, old, new)]) != version(tmp_path)


def test_a_definition_counts_the_same_in_another_file(tmp_path):
    before = version(tmp_path)
    shutil.rmtree(tmp_path / "app")
    moved = dict(TOY)
    kernels = moved.pop("app/kernels.py")
    moved |= {"app/rays/__init__.py": "", "app/rays/cast.py": kernels}
    moved["app/stages.py"] = moved["app/stages.py"].replace("app.kernels", "app.rays.cast")
    assert code_of(tmp_path, moved).version("app.stages.train") == before


def test_a_name_that_leads_to_another_of_two_definitions_counts(tmp_path):
    """Both count before and after, and no definition changes: only which is called where."""
    files = {
        "app/__init__.py": "",
        "app/a.py": "def f(x):\n    return x + 1\n",
        "app/b.py": "def f(x):\n    return x + 2\n",
        "app/go.py": "from app.a import f as g\nfrom app.b import f as h\n"
        "def run(x):\n    return g(x) - 3 * h(x)\n",
    }
    before = code_of(tmp_path, files).version("app.go.run")
    files["app/go.py"] = files["app/go.py"].replace(".a", ".c").replace(".b", ".a")
    files["app/go.py"] = files["app/go.py"].replace(".c", ".b")
    assert code_of(tmp_path, files).version("app.go.run") != before


def test_what_a_root_is_handed_counts_by_the_types_that_it_names(tmp_path):
    files = dict(TOY) | {
        "app/go.py": "from app.models import Settings\n"
        "def run(settings: Settings):\n    return settings.area()\n"
    }
    before = code_of(tmp_path, files).version("app.go.run")
    files["app/models.py"] = files["app/models.py"].replace("x * x", "x")
    assert code_of(tmp_path, files).version("app.go.run") != before


def test_modules_imported_by_name_count_all_unless_a_root_says_which(tmp_path):
    files = {
        "app/__init__.py": "",
        "app/go.py": "import importlib\n"
        "def run(name):\n    return importlib.import_module(f'app.nets.{name}').build()\n",
        "app/nets/__init__.py": "",
        "app/nets/one.py": "def build():\n    return 1\n",
        "app/nets/two.py": "def build():\n    return 2\n",
    }
    changed = files | {"app/nets/two.py": "def build():\n    return 3\n"}
    for roots, counts in (
        (["app.go.run"], True),
        (["app.go.run", "app.nets.one"], False),
        (["app.go.run", "app.nets.two"], True),
    ):
        versions = {code_of(tmp_path, f).version(*roots) for f in (files, changed)}
        assert (len(versions) == 2) == counts


@pytest.mark.parametrize(
    "call", ["import_module(name)", "__import__(name)", "import_module('app.' + name)"]
)
def test_an_import_that_cannot_be_followed_is_refused(tmp_path, call):
    files = {
        "app/__init__.py": "",
        "app/go.py": f"from importlib import import_module\ndef run(name):\n    return {call}\n",
    }
    with refused(("go.py: line 3", "", "")):
        code_of(tmp_path, files).version("app.go.run")


@pytest.mark.parametrize("root", ["app.go.run", "app.stages.nothing", "other.train"])
def test_a_root_that_leads_nowhere_is_refused(tmp_path, root):
    with refused((root, "", "")):
        version(tmp_path, root=root)


# The project itself


@pytest.fixture
def copied(tmp_path):
    for name in PACKAGES:
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / name, tmp_path / name, ignore=ignored)
    return tmp_path


def code_in(folder):
    return Code({name: folder / name for name in PACKAGES})


def versions(code):
    """Versions of all stages, for simulated traffic and one network."""
    stages = FUNCTIONS["scene"].__module__
    return {
        stage: code.version(f"{stages}.{stage}", *filter(None, [OWN.get(stage)]))
        for stage in FUNCTIONS
    }


@pytest.fixture(scope="module")
def original():
    return code_in(ROOT)


@pytest.fixture(scope="module")
def before(original):
    return versions(original)


def test_comments_figures_converters_and_the_command_line_leave_stages_as_they_are(copied, before):
    for path in copied.rglob("*.py"):
        text = path.read_text()
        path.write_text(f"{text}\n# a comment\n" + '"""A docstring."""\n')
    spared = ["viewing/*.py", "**/nuscenes.py", "**/argoverse.py", "**/command_line.py"]
    paths = [p for spare in spared for p in (copied / "lidarplace").glob(spare)]
    assert len(paths) > 5
    for path in paths + list((copied / "tracking").rglob("*.py")):
        text = path.read_text().replace("return ", "return None or ")
        path.write_text(f"{text}\nANOTHER = 1\n")
    # A command reads and writes the layouts of these data sets; no other stage does.
    now = versions(code_in(copied))
    assert {stage for stage in now if now[stage] != before[stage]} == {"command"}


@pytest.mark.parametrize(
    ("path", "old", "new", "stages"),
    [
        (
            *("lidarplace/coverage/cone_sines.py", "HAIR = 1e-9", "HAIR = 1e-8"),
            {"surrogates", "requirements", "accuracy", "sampling_error"},
        ),
        ("lidarplace/clouds/returns.py", "_PER_M = 0.004", "_PER_M = 0.005", {"collect", "judge"}),
        ("training/ops/box_overlap.py", "_CLIPPED = 1 << 19", "_CLIPPED = 1 << 18", set(TRAINED)),
        ("training/average_precision.py", "= 0, 1, -1", "= 0, 2, -1", {"evaluate", "measure"}),
        (
            "training/detectors/pointpillars.py",
            *("from training.detectors.detector", "CELL = 1\nfrom training.detectors.detector"),
            set(TRAINED),
        ),
        ("training/detectors/second.py", "from torch import", "CELL = 1\nfrom torch import", set()),
        ("training/__init__.py", '    "pv_rcnn",\n', '    "pv_rcnn",\n    "pv_rcnn_2",\n', set()),
        ("lidarplace/scenes/sumo/record.py", "MEETS_M = 40.0", "MEETS_M = 41.0", {"scene"}),
        ("lidarplace/scenes/kinds.py", '"sumo": Sc', '"toy": None, "sumo": Sc', set()),
    ],
)
def test_a_constant_counts_where_it_can_run(original, before, tmp_path, path, old, new, stages):
    text = (ROOT / path).read_text()
    assert text.count(old) == 1
    (edited := tmp_path / "edited.py").write_text(text.replace(old, new))
    module = path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    code = copy(original)
    code._sources = original._sources | {module: read_source(edited, module)}  # the others once
    after = versions(code)
    assert {stage for stage in after if after[stage] != before[stage]} == stages
