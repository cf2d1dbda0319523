"""Parameters of tasks whose stages a test replaces."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Toy:
    n: Any = None
