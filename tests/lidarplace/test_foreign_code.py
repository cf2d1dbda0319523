"""What code of plug-ins may do, and what names it in one line."""

import logging
import os
import sys
import threading
import warnings

import numpy as np
import pytest

from lidarplace.base import foreign_code as module
from lidarplace.base.errors import InputError
from lidarplace.base.foreign_code import foreign_code, import_plugin


def test_harmless_code_and_documented_errors_pass():
    with foreign_code("plug"):
        warnings.filterwarnings("ignore", category=DeprecationWarning)
        warnings.filterwarnings("error", message="one of its own", module="plug")
        np.seterr(all="raise")
    assert np.geterr()["divide"] != "raise", "of its own computations alone"
    for error in (OSError("no file"), MemoryError(), KeyboardInterrupt()):
        with pytest.raises(type(error)) as raised, foreign_code("plug", (OSError,)):
            raise error
        assert raised.value is error
    stop = SystemExit(1)
    stop.ray_terminate_msg = "The process receives a SIGTERM."
    with pytest.raises(SystemExit), foreign_code("plug"):
        raise stop


def test_an_exit_is_an_error_whatever_its_code():
    with pytest.raises(InputError, match=r"^plug: calls sys.exit\(0\)$"), foreign_code("plug"):
        sys.exit(0)


def test_a_closed_descriptor_is_named_and_taken(tmp_path):
    """A file that is opened later must not become standard output."""
    kept = os.dup(1)
    try:
        with pytest.raises(InputError, match=r"^plug: closes sys.stdout$"), foreign_code("plug"):
            os.close(1)
        with (tmp_path / "later").open("w") as later:
            assert later.fileno() != 1
    finally:
        os.dup2(kept, 1)
        os.close(kept)


def test_an_import_that_hangs_is_named(tmp_path, monkeypatch):
    """It goes on when the line is there."""
    named = threading.Event()

    class Handler(logging.Handler):
        def emit(self, record):
            lines.append(record.getMessage())
            named.set()

    lines: list[str] = []
    monkeypatch.setattr(module, "SLOW_IMPORT_S", 0.0)
    monkeypatch.setattr(threading, "named_by_test", named, raising=False)
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "plug_slow.py").write_text("import threading\nONE = threading.named_by_test.wait()")
    module._log.addHandler(handler := Handler())
    try:
        assert import_plugin("plug_slow:ONE", "slow (plug_slow:ONE)") is True
    finally:
        module._log.removeHandler(handler)
        sys.modules.pop("plug_slow", None)
    assert lines == ["slow (plug_slow:ONE): its import takes more than 0 s"]


def test_harm_of_an_import_is_named_each_time(tmp_path, monkeypatch):
    """A second import runs no code: the module is there."""
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "plug_strict.py").write_text(
        "import warnings\nwarnings.simplefilter('error')\nX = 1"
    )
    with warnings.catch_warnings():
        for _ in range(2):
            with pytest.raises(InputError, match=r"imported: turns warnings into errors"):
                import_plugin("plug_strict:X", "plug")
    sys.modules.pop("plug_strict", None)
