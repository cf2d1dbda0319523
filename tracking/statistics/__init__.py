"""Statistics: arrays in, arrays out."""

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]
