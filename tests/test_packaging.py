"""Requirements, files and help of the package agree with its source."""

import ast
import os
import re
import subprocess
import sys
import tomllib
from functools import cache
from importlib.resources import files
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from lidarplace.base.code_version import PACKAGES
from lidarplace.base.optional import EXTRAS
from sweeps.command_line import VERBS
from tests.tracking.made_up_run import write_run

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
OWN = set(PACKAGES)
MODULES = {
    "carla": ["carla"],
    "eclipse-sumo": ["sumo"],
    "foxglove-sdk": ["foxglove"],
    "Jinja2": ["jinja2"],
    "optuna-dashboard": ["optuna_dashboard"],
    "psycopg2-binary": ["psycopg2"],
    "pydantic-core": ["pydantic_core"],
    "PyYAML": ["yaml"],
    "typing-extensions": ["typing_extensions"],
}
"""What a distribution is imported as, if by another name."""

MAY_IMPORT = {
    "lidarplace": ["", "sumo", "carla", "mcap", "mesh", "studio"],
    "training": ["", "training"],
    "tracking": ["", "sweeps"],
    "sweeps": ["", "training", "sweeps"],
}
"""Extras by package, "" being what every installation has."""

BROUGHT = {"training": {"triton"}, "sweeps": {"triton"}}  # by the builds of torch that are for GPUs

NOT_IMPORTED = {
    "cmaes": "Optuna's sampler of that name",
    "optuna_dashboard": "a program",
    "psutil": "MLflow's monitors of the machine",
    "psycopg2": "SQLAlchemy's driver",
    "s3fs": "fsspec's client",
}


def modules_of(extra: str) -> set[str]:
    """Modules of the requirements of an extra, without other extras."""
    lines = PROJECT["optional-dependencies"][extra] if extra else PROJECT["dependencies"]
    names = {Requirement(line).name for line in lines} - {PROJECT["name"]}
    return {module for name in names for module in MODULES.get(name, [name])}


def imports(tree: ast.AST, everywhere: bool) -> set[str]:
    """Packages imported below `tree`; in functions and for types only if `everywhere`."""
    names: set[str] = set()
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add(str(node.module).partition(".")[0])
        lazy = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) or (
            isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        )
        if everywhere or not lazy:
            names |= imports(node, everywhere)
    return names - OWN - set(sys.stdlib_module_names)


@cache
def imports_of(package: str, everywhere: bool = True) -> dict[str, set[str]]:
    """Imports by file."""
    paths = sorted((ROOT / package).rglob("*.py"))
    assert paths
    return {
        str(path.relative_to(ROOT)): imports(ast.parse(path.read_text("utf-8")), everywhere)
        for path in paths
    }


@pytest.mark.parametrize("package", sorted(OWN))
def test_what_is_imported_is_declared(package):
    declared = BROUGHT.get(package, set()).union(*map(modules_of, MAY_IMPORT[package]))
    undeclared = {path: names - declared for path, names in imports_of(package).items()}
    assert not {path: names for path, names in undeclared.items() if names}


def test_what_is_declared_is_imported():
    declared = {m for extra in ("", *PROJECT["optional-dependencies"]) for m in modules_of(extra)}
    declared -= (modules_of("dev") | modules_of("docs")) - set(EXTRAS)
    used = {name for package in OWN for names in imports_of(package).values() for name in names}
    assert declared - used == set(NOT_IMPORTED)


@pytest.mark.parametrize("package", ["lidarplace", "tracking"])
def test_what_not_everybody_has_is_imported_where_it_is_used(package):
    # A function imports this module, which is about its package alone.
    at_work = {"lidarplace/viewing/mcap.py": {"foxglove"}}
    for path, names in imports_of(package, everywhere=False).items():
        assert not names & set(EXTRAS) - at_work.get(str(path), set()), path


def test_the_extra_that_is_named_brings_the_package():
    extras = set(PROJECT["optional-dependencies"]) - {"all", "cluster", "dev", "docs"}
    assert {module: extra for extra in extras for module in modules_of(extra)} == EXTRAS


def test_all_has_what_verbs_need():
    (everything,) = map(Requirement, PROJECT["optional-dependencies"]["all"])
    assert everything.name == PROJECT["name"]
    assert {verb.extra for verb in VERBS.values()} - {"", "carla"} <= everything.extras
    assert everything.extras == {"training", "sweeps", "sumo", "studio"}


@pytest.mark.parametrize("package", sorted(OWN))
def test_types_are_promised(package):
    assert files(package).joinpath("py.typed").is_file()


def test_constraints_have_every_requirement():
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pinned = {re.sub(r"[-_.]+", "-", line.partition("==")[0]).lower() for line in lines}
    wanted = (PROJECT["dependencies"], *PROJECT["optional-dependencies"].values())
    names = {Requirement(line).name for lines in wanted for line in lines}
    names = {re.sub(r"[-_.]+", "-", name).lower() for name in names}
    assert names - pinned <= {"lidarplace", "s3fs"}, "s3fs is for those who have such a store"


BARE = """
import sys
from importlib.abc import MetaPathFinder
from lidarplace.base.optional import EXTRAS

class NotInstalled(MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name in EXTRAS:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, NotInstalled())
"""
"""Python as after `pip install lidarplace`."""


LINES = {
    "run": ("run", "examples/grid.yaml"),
    "search": ("search", "examples/search.yaml", "--dry-run"),
    "cheapest": ("cheapest", "examples/search.yaml"),
    "figures": ("figures", "runs/grid"),
    "dashboard": ("dashboard", "runs/mlflow.db"),
    "record": ("record", "examples/grid.yaml", "logs"),
    "pretrain": ("pretrain", "examples/grid.yaml", "--out", "base.pt"),
    "carla": ("carla", "carla.yaml", "out"),
    "studio": ("studio", "rigs.yaml"),
}


@pytest.fixture(scope="module")
def bare(tmp_path_factory):
    """What such a Python prints of every verb's help, and of those that lack a package; in a
    folder with the examples and a database."""
    folder = tmp_path_factory.mktemp("bare")
    (folder / "runs").mkdir()
    (folder / "runs/mlflow.db").write_text("nobody opens it")
    write_run(folder / "runs/grid")
    code = f"""
from pathlib import Path
from typer.testing import CliRunner
from sweeps.command_line import VERBS, app
for name in VERBS:
    done = CliRunner().invoke(app, [name, "--help"], catch_exceptions=False)
    print("help", name, done.exit_code)
print(CliRunner().invoke(app, ["init"], catch_exceptions=False).stdout)
Path("carla.yaml").write_text("{{}}")
for line in {list(LINES.values())}:
    done = CliRunner().invoke(app, line, catch_exceptions=False, prog_name="lidarplace")
    print(">", done.exit_code, done.stdout + done.stderr, end="")
"""
    return subprocess.run(
        [sys.executable, "-c", BARE + code],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )


def test_every_verb_has_help_in_every_installation(bare):
    lines = [line for line in bare.stdout.splitlines() if line.startswith("help")]
    assert lines == [f"help {name} 0" for name in VERBS], bare.stderr


def test_a_package_that_is_not_installed_is_one_line(bare):
    assert set(LINES) == {name for name, verb in VERBS.items() if verb.extra}
    lines = [line for line in bare.stdout.splitlines() if line.startswith(">")]
    assert len(lines) == len(LINES), bare.stdout + bare.stderr
    for name, line in zip(LINES, lines, strict=True):
        missing = r"needs the package \w+: pip install 'lidarplace\[\w+\]'"
        client = "CARLA's client is missing: pip install carla==<version of the server>"
        assert re.fullmatch(rf"> 2 .*{missing}|> 2 {re.escape(client)}", line), f"{name}: {line}"


def test_init_writes_the_examples(tmp_path):
    from typer.testing import CliRunner

    from sweeps.commands.init import app

    def init(answer=None):
        return CliRunner().invoke(app, [str(tmp_path / "new")], input=answer)

    result = init()
    assert result.exit_code == 0, result.output
    paths = [path for path in (tmp_path / "new").rglob("*") if path.is_file()]
    written = {str(path.relative_to(tmp_path / "new")): path.read_bytes() for path in paths}
    for name, content in written.items():
        assert content == (ROOT / "examples" / name).read_bytes()
        assert (ROOT / "sweeps/examples" / name).samefile(ROOT / "examples" / name), "one source"
    grid = tmp_path / "new/grid.yaml"
    grid.write_text("my: grid\n")
    for answer, code in (("", 2), ("n\n", 0)):
        result = init(answer)
        assert (result.exit_code, grid.read_text()) == (code, "my: grid\n"), result.output
    assert "grid.yaml exists" in result.output
    init("y\n")
    assert grid.read_bytes() == written["grid.yaml"]


def test_init_writes_what_help_and_readme_name():
    modules = [
        path for package in ("sweeps", "lidarplace") for path in (ROOT / package).rglob("*.py")
    ]
    from sweeps.commands.init import examples

    text = "".join(path.read_text("utf-8") for path in modules)
    for commands in re.findall(r"```sh\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL):
        text += commands
    assert set(re.findall(r"examples/([\w/]+\.(?:yaml|csv))", text)) == set(examples())
