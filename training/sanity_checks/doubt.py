"""A doubt about detections: which column, what is wrong with it, and how to mend it."""

from typing import Literal, NamedTuple

DetectionCheck = Literal[
    "rows", "place", "yaw", "size", "ground", "time", "class", "score", "overlap"
]
"""Subject of a check, which may be accepted as it is."""


class DetectionDoubt(NamedTuple):
    """Detections with implausible values."""

    check: DetectionCheck
    column: str  # the first of several
    why: str
    remedy: str
    certain: bool = True  # whether no detector does this, so that it is refused
