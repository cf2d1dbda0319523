"""The one-cycle schedule of learning rate and momentum."""

import math
from dataclasses import dataclass

from training.settings import TrainingSettings


@dataclass(frozen=True)
class OneCycle:
    """Learning rate up and down, momentum down and up, both along cosines.

    As fastai and OpenPCDet (`adam_onecycle`): from lr / div_factor to lr during the first
    `pct_start` of the steps, then to lr / div_factor / 10,000.
    """

    settings: TrainingSettings
    steps: int

    def __call__(self, step: int) -> tuple[float, float]:
        """Learning rate and first Adam coefficient of step 0, 1, …, steps - 1."""
        s = self.settings
        low = s.lr / s.div_factor
        top = int(s.pct_start * self.steps)
        if step < top:
            part = step / top
            return _cosine(low, s.lr, part), _cosine(s.moms[0], s.moms[1], part)
        part = (step - top) / (self.steps - top)
        return _cosine(s.lr, low / 1e4, part), _cosine(s.moms[1], s.moms[0], part)


def _cosine(start: float, end: float, part: float) -> float:
    return end + (start - end) / 2 * (math.cos(math.pi * part) + 1)
