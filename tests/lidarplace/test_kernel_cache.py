"""Machine code on the disk belongs to the sources that it was compiled from, whichever file."""

import importlib
import sys
import time

import numba
import pytest

from lidarplace.base import kernel_cache
from lidarplace.base.code_version import forget_versions
from lidarplace.base.kernel_cache import njit

FILES = {
    "__init__": "",
    "numbers": "FACTOR = 2.0\n",
    "inner": """
from lidarplace.base.kernel_cache import njit
from toy.numbers import (
    FACTOR,  # of all
)

@njit(error_model="numpy", no_cpython_wrapper=True)
def inner(x):
    return FACTOR * x + 1.0
""",
    "middle": """
from lidarplace.base.kernel_cache import njit
from toy import inner as kernels

inner = kernels.inner

@njit(cache=True)
def middle(x):
    return inner(x)
""",
    "outer": """
from lidarplace.base.kernel_cache import njit
from toy.middle import middle

@njit(cache=True)
def outer(x):
    return middle(x)
""",
    "other": "",
}


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Writes the package, imports it as a new process would, and calls its outer kernel."""
    package = tmp_path / "toy"
    package.mkdir()
    monkeypatch.syspath_prepend(tmp_path)
    # Python's own would tell two edits of one second and one length not apart.
    monkeypatch.setattr(sys, "dont_write_bytecode", True)

    def write(edited):
        for name, source in (FILES | edited).items():
            (package / f"{name}.py").write_text(source, encoding="utf-8")

    def run(before_the_call=None, **edited):
        write(edited)
        monkeypatch.setattr(kernel_cache, "_IMPORTED", time.time() + 0.1)
        for name in [name for name in sys.modules if name.partition(".")[0] == "toy"]:
            del sys.modules[name]
        forget_versions()
        outer = importlib.import_module("toy.outer").outer
        if before_the_call is not None:
            time.sleep(0.2)
            write(before_the_call)
        return outer(3.0), sum(outer.stats.cache_hits.values())

    return run


def test_an_edit_of_any_source_that_a_kernel_uses_compiles_it_again(run, tmp_path):
    assert run() == (7.0, 0)
    assert run(other="FACTOR = 5.0\n") == (7.0, 1)
    assert run(numbers="FACTOR = 30.0\n") == (91.0, 0)
    assert run(inner=FILES["inner"].replace("+ 1.0", "- 1.0")) == (5.0, 0)
    assert run() == (7.0, 1)  # back on the branch of before
    assert run(numbers="FACTOR = 4.0\n") == (13.0, 0)
    assert len(list(tmp_path.glob("toy/__pycache__/outer-*/"))) == 3


def test_machine_code_of_sources_that_changed_before_the_first_call_is_not_kept(run):
    edited = {"numbers": "FACTOR = 30.0\n"}
    assert run(before_the_call=edited) == (7.0, 0)
    assert run(**edited) == (91.0, 0)
    assert run() == (7.0, 0)


def test_a_folder_that_the_user_names_is_taken(run, tmp_path, monkeypatch):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "named"))
    assert run() == (7.0, 0)
    assert run() == (7.0, 1)
    assert run(numbers="FACTOR = 30.0\n") == (91.0, 0)
    assert str(tmp_path / "named") == numba.config.CACHE_DIR
    assert len(list(tmp_path.glob("named/*/outer-*/"))) == 2
    assert not (tmp_path / "toy" / "__pycache__").exists()


def test_literals_compile_a_kernel_once():
    inner = njit()(lambda x, y: x + y)
    outer = njit()(lambda n: inner(1, 2) + inner(n, y=3))
    assert outer(4) == 10
    assert inner.signatures == [(numba.int64, numba.int64)]
