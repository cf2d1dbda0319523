"""The figure of the page: how each predictor goes with what the rigs' own detectors reach."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from predicting import PREDICTORS, named
from rig_results import SHORT, RigResults, head_of, label

SHOWN = ("car07", "car", "recall")
_INK, _ACCENT, _BAND = "#1f2933", "#0b6e99", "#dfe7ec"


def write_figure(judged: RigResults, path: Path) -> None:
    """A panel a target; a dot is Spearman's rho, its bar 95 %, the line the ceiling."""
    order = [name for name in PREDICTORS if name != "ig"]  # covered entropy with the other sign
    figure, panels = plt.subplots(1, len(SHOWN), figsize=(11, 4.6), sharey=True, dpi=110)
    for panel, target in zip(panels, SHOWN, strict=True):
        _panel(panel, judged, target, order)
    panels[0].set_yticks(range(len(order)), [label(name).replace("*", "") for name in order])
    panels[0].invert_yaxis()
    figure.supxlabel("Spearman's ρ over rigs, 95 %; dashed: the ceiling", fontsize=10, color=_INK)
    figure.tight_layout()
    figure.savefig(path)
    plt.close(figure)


def _panel(panel: Axes, judged: RigResults, target: str, order: list[str]) -> None:
    ceiling = judged.ceilings.loc[named(SHORT[target]), "ceiling"]
    panel.axvline(0, color=_BAND, linewidth=1)
    panel.axvline(float(ceiling), color=_INK, linestyle="--", linewidth=1)
    for row, name in enumerate(order):
        found = judged.row(name, target)
        if not np.isfinite(found["spearman"]):
            continue
        panel.plot(
            [found["spearman_low"], found["spearman_high"]], [row] * 2, color=_BAND, linewidth=6
        )
        panel.plot(found["spearman"], row, "o", color=_ACCENT, markersize=6)
    panel.set_title(head_of(target), fontsize=11, color=_INK)
    panel.set_xlim(-1, 1.02)
    panel.tick_params(colors=_INK, length=0)
    for side in ("top", "right", "left"):
        panel.spines[side].set_visible(False)
