"""A doubt about a box log: which column, which boxes, and how to mend it."""

from typing import Literal, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lidarplace.base.number_text import number
from lidarplace.logs.boxes import SIZE

Check = Literal["yaw", "size", "place", "ground", "time", "poses", "duplicates", "split"]
"""Subject of a check; a mapping of columns may accept it as it is."""
OF_FRAMES = ("poses", "time")  # checks whose rows are frames
LEAST_BOXES = 20  # fewer boxes are no evidence beyond doubt


class Doubt(NamedTuple):
    """Boxes, or for some checks frames, with implausible values."""

    check: Check
    column: str  # of the box log, or of its frames; the first of several
    boxes: NDArray[np.bool_]  # which, or which frames, shape (boxes,); at least one
    why: str  # what is wrong with them
    remedy: str  # the keys of a mapping that would mend it
    certain: bool = False  # whether no real traffic looks like this, so that it is refused

    def where(self, boxes: pd.DataFrame) -> str:
        """How many of the boxes (or frames) of the log, and the first of them with its values."""
        rows = "frames" if self.check in OF_FRAMES else "boxes"
        box = boxes[self.boxes].iloc[0]
        value = number(box[self.column])
        if self.check == "size":
            value = " x ".join(number(box[side]) for side in SIZE)
        elif self.check in ("place", "duplicates", "split"):
            value = f"x {value}, y {number(box['y'])}"
        return (
            f"{self.boxes.sum():,} of {len(boxes):,} {rows} ({self.boxes.mean():.1%}), the first "
            f"in frame {box['frame']} with {value}"
        )
