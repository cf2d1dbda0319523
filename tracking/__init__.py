"""What results mean and how they are shown: statistics, figures, reports, MLflow."""

import signal
import sys

# As in lidarplace.start, which would import numba first.
if sys.argv[0] == "-m" and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)
