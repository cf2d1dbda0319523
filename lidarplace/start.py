"""Ctrl-C while a program of this package imports ends it without a traceback, like programs in C.

Work that has begun stops in its own way, see `lidarplace.command_line.signals`. The handler of any
other process stays. Python imports the packages around the module of `-m` before it looks for it.
"""

from __future__ import annotations

import signal
import sys

_OURS = " ".join(sys.orig_argv[1:3]).startswith("-m lidarplace.")
if _OURS and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)
