"""What results mean and how they are shown: statistics, figures, reports, MLflow."""

import signal
import sys

# As in lidarplace.command_line.start, which would import numba first.
_OURS = " ".join(sys.orig_argv[1:3]).startswith("-m tracking.")
if _OURS and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)
