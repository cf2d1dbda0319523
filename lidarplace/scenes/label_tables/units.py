"""Units of label files, as factors to metres, radians and seconds."""

import math
from typing import Literal

LengthUnit = Literal["m", "cm", "mm"]
AngleUnit = Literal["rad", "deg"]
TimeUnit = Literal["s", "ms", "us", "ns"]

METRES: dict[LengthUnit, float] = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
RADIANS: dict[AngleUnit, float] = {"rad": 1.0, "deg": math.pi / 180}
SECONDS: dict[TimeUnit, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
