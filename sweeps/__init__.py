"""Sweeps and searches: configuration, tasks, execution, results and the command line."""

import signal
import sys

# As in lidarplace.start, which would import numba first.
if (
    sys.argv[0].endswith(("-m", "/lidarplace"))
    and signal.getsignal(signal.SIGINT) is signal.default_int_handler
):
    signal.signal(signal.SIGINT, signal.SIG_DFL)
