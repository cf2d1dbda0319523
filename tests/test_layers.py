"""The house rules of imports: packages, and the rooms in them, only use what is below them."""

import ast
import subprocess
import sys
from functools import cache
from graphlib import TopologicalSorter
from importlib import import_module
from pathlib import Path

import pytest

from lidarplace.base.code_version import PACKAGES

ROOT = Path(__file__).parents[1]
OWN = set(PACKAGES)
PLUGINS = "lidarplace.plugins"
ALLOWED = {
    "lidarplace": {"lidarplace"},
    "training": {"training", "lidarplace"},
    "tracking": {"tracking", "lidarplace"},
    "sweeps": OWN,
}
FORBIDDEN = {
    "lidarplace": {"torch", "ray", "mlflow", "optuna"},
    "training": {"ray", "mlflow", "optuna"},
    "tracking": {"torch", "ray"},
    "sweeps": set(),
}
FLOORS = {
    "lidarplace": (
        "base",
        "files rigs",
        "coverage logs",
        "mounting pog",
        "configuration",
        "clouds",
        "command_line recall viewing",
        "__init__ requirements scenes",
        "detections rig_files validation",
        "commands studio",
    ),
    "lidarplace.scenes": (
        "datasets parts routes sanity_checks site",
        "*",
        "kinds layouts",
        "kerbs",
    ),
    "training": (
        "nvidia ops",
        "average_precision casting dataset device prediction_batches randomness settings "
        "typical_objects",
        "detectors ground_truth_sampling kitti_labels matches sanity_checks",
        "__init__ augment leave_out optimisation",
        "checkpoints",
        "batch_size detect kitti_ap resume",
        "by_place finetune",
        "pretrained",
    ),
    "training.detectors": (
        "detector layers",
        "backbones build",
        "heads",
        "one_stage_detector pointrcnn voxel_detector",
        "second two_stage_voxel_detector",
        "*",
    ),
    "tracking": (
        "kitti_iou labels published",
        "run_folders statistics",
        "findings",
        "figures",
        "mlflow pages",
        "dashboard report search_report validation",
    ),
    "tracking.figures": ("kit", "of_searches"),
    "tracking.report": (
        "headline",
        "recommendation",
        "analysis",
        "cautions sections",
        "decision paper_figures",
        "failures",
        "build",
        "command figures_command",
    ),
    "sweeps": (
        "configuration",
        "stages",
        "options plan store",
        "execution",
        "calibration results",
        "evaluation mlflow",
        "run_sweep",
        "search",
        "benchmark sweep_or_search",
        "commands",
        "command_line",
        "main",
        "run",
    ),
    "sweeps.search": ("problem", "greedy trials", "cheapest verification", "output", "adapt run"),
}
"""Files and folders of a package, each on the floor above all that it imports, ground first.

"*" stands for all that are not named.
"""


def modules() -> dict[str, Path]:
    """Every module of the project by its dotted name."""
    imports = {}
    for package in sorted(OWN):
        for path in sorted((ROOT / package).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            imports[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return imports


MODULES = modules()


def imported(path: Path) -> set[str]:
    """Dotted names of the modules that a file imports, wherever in it."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            of = {alias.name: f"{node.module}.{alias.name}" for alias in node.names}
            names |= {full if full in MODULES else str(node.module) for full in of.values()}
        elif isinstance(node, ast.Call) and "import_module" in vars(node.func).values():
            names |= {path.value for path in node.args[:1] if isinstance(path, ast.Constant)}
    return names


@cache
def imports() -> dict[str, set[str]]:
    """Module -> what it imports."""
    return {module: imported(path) for module, path in MODULES.items()}


@pytest.mark.parametrize("package", sorted(OWN))
def test_no_package_imports_upwards(package):
    for module, names in imports().items():
        roots = {name.partition(".")[0] for name in names}
        if module.partition(".")[0] == package:
            assert roots & OWN <= ALLOWED[package], module
            assert not roots & FORBIDDEN[package], module


def room(module: str, folder: str) -> str | None:
    """File or folder of `folder` that a module is, or is in; None: it is elsewhere."""
    if module == folder:
        return "__init__"
    return (
        module.removeprefix(f"{folder}.").split(".")[0] if module.startswith(f"{folder}.") else None
    )


def floors_of(folder: str) -> dict[str, int]:
    """The floor of every room of a folder, from the ground up."""
    floors = {name: number for number, names in enumerate(FLOORS[folder]) for name in names.split()}
    if "*" in floors:
        number = floors.pop("*")
        rooms = {name for module in MODULES if (name := room(module, folder))} - {"__init__"}
        floors |= dict.fromkeys(rooms - floors.keys(), number)
    return floors


@pytest.mark.parametrize("folder", FLOORS)
def test_no_room_imports_upwards(folder):
    inside = {
        m: member for m in MODULES if (member := room(m, folder)) and not m.startswith(PLUGINS)
    }
    floors = floors_of(folder)
    assert floors.keys() - {"__init__"} == set(inside.values()) - {"__init__"}
    for module, member in inside.items():
        for name in imports()[module]:
            other = room(name, folder)
            if other in floors and other != member:
                assert floors[other] < floors[member], f"{module} imports {name}"


def test_nobody_imports_a_plug_in():
    """It may import every room of lidarplace: it is on no floor."""
    for module, names in imports().items():
        if not module.startswith(PLUGINS):
            assert not {name for name in names if name.startswith(PLUGINS)}, module


def test_what_scripts_import_of_ours_is_there():
    """Of benchmarks, studies and programs of the docs, which no other test runs."""
    scripts = ("benchmarks", "docs", "studies")
    for path in (path for folder in scripts for path in (ROOT / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and str(node.module).partition(".")[0] in OWN:
                module = import_module(str(node.module))
                for name in {alias.name for alias in node.names}:
                    exists = f"{node.module}.{name}" in MODULES or hasattr(module, name)
                    assert exists, f"{path}: {node.module} has no {name}"


def test_no_modules_import_each_other():
    ours = {module: names & MODULES.keys() for module, names in imports().items()}
    TopologicalSorter(ours).prepare()  # raises an error that names a circle


def test_all_kernels_are_compiled_by_the_njit_that_knows_their_sources():
    users = [m for m, path in MODULES.items() if "numba.njit(" in path.read_text("utf-8")]
    assert users == ["lidarplace.base.kernel_cache"]
    for module, path in MODULES.items():
        assert "from numba import" not in path.read_text("utf-8"), module


def test_importing_lidarplace_brings_in_no_heavy_or_optional_library():
    heavy = ["torch", "ray", "mlflow", "optuna", "libsumo", "plotly"]
    code = f"import sys, lidarplace; print([m for m in {heavy} if m in sys.modules])"
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert result.stdout.strip() == "[]"


def test_importing_any_module_changes_nothing_of_the_process():
    code = """
import os, signal, sys
from importlib import import_module
import numpy
def state():
    handlers = {number: signal.getsignal(number) for number in signal.valid_signals()}
    return handlers, [*sys.path], sys.excepthook, os.getcwd(), numpy.geterr()
before = state()
for module in sys.argv[1:]:
    import_module(module)
    assert state() == before, module
"""
    modules = sorted(module for module in MODULES if ".carla" not in module)  # needs its client
    subprocess.run([sys.executable, "-c", code, *modules], cwd=ROOT, check=True)
