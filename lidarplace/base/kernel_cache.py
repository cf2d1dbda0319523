"""`numba.njit` with a disk cache for each version of the sources that a kernel is compiled from.

numba's own cache looks at the kernel's file alone, and misses an edit of another file that it uses.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core.caching import NullCache
from numba.core.types.abstract import Type
from numba.core.types.misc import unliteral

from lidarplace.base.code_version import changed_since, code_version

Kernel = TypeVar("Kernel", bound=Callable[..., Any])

_IMPORTED = time.time()
"""When this module was imported, before all kernels; seconds since 1970."""
_KEPT = 3
"""Versions of a file whose machine code stays on the disk, as branches are switched."""


def njit(**options: Any) -> Callable[[Kernel], Kernel]:
    """Return `numba.njit` with these options, the decorator of all kernels of this project.

    With `cache=True` machine code is in a folder of the sources' version, below the one that numba
    chooses: `NUMBA_CACHE_DIR`, else `__pycache__` next to the file, else the user's cache folder.
    """

    def compiled(function: Callable[..., Any]) -> Any:
        # Nothing calls kernels from C, and what an inlined step calls need not be inlined, too.
        settings = {"no_cfunc_wrapper": True, "forceinline": False, **options}
        kernel = numba.njit(**settings)(function)
        if numba.config.DISABLE_JIT:
            return kernel
        resolve = kernel.get_call_template

        def resolved(args: list[Type], named: dict[str, Type]) -> Any:
            """Resolve without literals: numba would compile the kernel for each of them."""
            return resolve(list(map(unliteral, args)), {n: unliteral(t) for n, t in named.items()})

        kernel.get_call_template = resolved
        if options.get("cache"):
            kernel._cache = _VersionedCache(kernel)
        return kernel

    return compiled


inner = njit(error_model="numpy", no_cpython_wrapper=True)
"""For functions that compiled code alone calls: they take a quarter less time to compile."""
inlined = njit(error_model="numpy", no_cpython_wrapper=True, forceinline=True)
"""For steps of one kernel: their code becomes part of its loops."""


class _VersionedCache:
    """Disk cache of a kernel, opened when the kernel is first called: it hashes all sources.

    None if these have changed since they were imported: machine code would be filed under another
    version."""

    def __init__(self, kernel: Any) -> None:
        self._kernel, self._parent = kernel, Path(kernel.stats.cache_path)

    def __getattr__(self, name: str) -> Any:
        kernel, chosen = self._kernel, numba.config.CACHE_DIR
        if changed_since(_IMPORTED, kernel.py_func.__module__):
            kernel._cache = NullCache()
            return getattr(kernel._cache, name)
        numba.config.CACHE_DIR = str(_folder(self._parent, kernel.py_func))
        try:
            kernel.enable_caching()
        finally:
            numba.config.CACHE_DIR = chosen
        return getattr(kernel._cache, name)


def _folder(parent: Path, function: Callable[..., Any]) -> Path:
    """Return the folder of a function's machine code; a new one replaces the file's oldest."""
    stem = Path(function.__code__.co_filename).stem
    folder = parent / f"{stem}-{code_version(function.__module__)[:16]}"
    if not folder.is_dir():
        with suppress(FileNotFoundError):  # another process does the same
            versions = sorted(parent.glob(f"{stem}-*/"), key=lambda path: path.stat().st_mtime)
            for old in versions[: 1 - _KEPT]:
                shutil.rmtree(old, ignore_errors=True)
    return folder
