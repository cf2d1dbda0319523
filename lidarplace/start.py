"""Ctrl-C while a program imports ends it without a word, as it ends programs in C.

What has begun by then stops in its own way, see `lidarplace.command_line.signals`. Python calls a
program of `-m` so until it has found its module, and so while it imports the packages around it.
"""

from __future__ import annotations

import signal
import sys

if sys.argv[0] == "-m" and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)
