"""`numba.njit` with a disk cache that looks at every source that a kernel is compiled from.

numba's own looks at the kernel's file alone, and misses an edit of another file that it uses.
"""

from __future__ import annotations

import hashlib
import re
import shutil
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core.types.abstract import Type
from numba.core.types.misc import unliteral

Kernel = TypeVar("Kernel", bound=Callable[..., Any])

_KEPT = 3
"""Versions of a file whose machine code stays on the disk: branches are switched to and fro."""

_IMPORT = re.compile(r"^(?:from|import) +([\w.]+)(?: +import +(\([^)]*\)|.*))?", re.MULTILINE)


def njit(**options: Any) -> Callable[[Kernel], Kernel]:
    """`numba.njit` with these options; all kernels of this project are compiled by it. With
    `cache=True` machine code is in a folder of the sources' version, below the one that numba
    chooses: `NUMBA_CACHE_DIR`, else `__pycache__` next to the file, else the user's cache
    folder."""

    def compiled(function: Callable[..., Any]) -> Any:
        # Nothing calls kernels from C.
        kernel = numba.njit(no_cfunc_wrapper=True, **options)(function)
        if numba.config.DISABLE_JIT:
            return kernel
        resolve = kernel.get_call_template

        def resolved(args: list[Type], named: dict[str, Type]) -> Any:
            """For a kernel that calls this one with literals: numba would compile it for each."""
            return resolve(list(map(unliteral, args)), {n: unliteral(t) for n, t in named.items()})

        kernel.get_call_template = resolved
        if options.get("cache"):
            chosen = numba.config.CACHE_DIR
            numba.config.CACHE_DIR = str(_folder(Path(kernel.stats.cache_path), function))
            try:
                kernel.enable_caching()
            finally:
                numba.config.CACHE_DIR = chosen
        return kernel

    return compiled


inner = njit(error_model="numpy", no_cpython_wrapper=True)
"""For functions that compiled code alone calls: they take a quarter less time to compile."""
inlined = njit(error_model="numpy", no_cpython_wrapper=True, forceinline=True)
"""For steps of one kernel: their code becomes part of its loops."""


def _folder(parent: Path, function: Callable[..., Any]) -> Path:
    """Where the machine code of a function is; the oldest versions of its file go for a new one."""
    stem = Path(function.__code__.co_filename).stem
    folder = parent / f"{stem}-{_version(function.__module__)}"
    if not folder.is_dir():
        with suppress(FileNotFoundError):  # another process does the same
            versions = sorted(parent.glob(f"{stem}-*/"), key=lambda path: path.stat().st_mtime)
            for old in versions[: 1 - _KEPT]:
                shutil.rmtree(old, ignore_errors=True)
    return folder


@cache
def _version(module: str) -> str:
    """Hash of the sources of a module and of all of its package and ours that it leads to."""
    packages = {__name__.partition(".")[0], module.partition(".")[0]}
    digests: dict[str, str] = {}
    open_ = [module]
    while open_:
        name = open_.pop()
        path = getattr(sys.modules.get(name), "__file__", None)
        if path and name not in digests and name.partition(".")[0] in packages:
            digests[name], imported = _source(path)
            open_ += imported
    return hashlib.sha256(repr(sorted(digests.items())).encode()).hexdigest()[:16]


@cache
def _source(path: str) -> tuple[str, list[str]]:
    """Hash of a source as it is imported, and the names in its imports that may be modules."""
    source = Path(path).read_bytes()
    imported = []
    for module, names in _IMPORT.findall(source.decode()):
        imported += [module, *(f"{module}.{name}" for name in re.findall(r"\w+", names))]
    return hashlib.sha256(source).hexdigest(), imported
