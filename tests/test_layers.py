"""The house rules of imports: each package only uses those below it."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
OWN = {"lidarplace", "training", "tracking", "sweeps"}
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


def imported(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names.add(str(node.module).partition(".")[0])
    return names


@pytest.mark.parametrize("package", sorted(OWN))
def test_nothing_imports_upwards(package):
    files = sorted((ROOT / package).rglob("*.py"))
    assert files
    for path in files:
        names = imported(path)
        assert names & OWN <= ALLOWED[package], path
        assert not names & FORBIDDEN[package], path


def test_importing_lidarplace_brings_in_no_heavy_or_optional_library():
    heavy = ["torch", "ray", "mlflow", "optuna", "libsumo", "plotly"]
    code = f"import sys, lidarplace; print([m for m in {heavy} if m in sys.modules])"
    found = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert found.stdout.strip() == "[]"
