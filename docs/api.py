"""Writes docs/api.md, the public names with signature and first line: `python docs/api.py`."""

from __future__ import annotations

import functools
import importlib
import inspect
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from lidarplace.base.registry import OneOf
from lidarplace.pog.surrogates.result import Surrogates
from lidarplace.pog.surrogates.table import POG_SURROGATES, SURROGATES

PAGE = Path(__file__).with_suffix(".md")

HEAD = """# Python

The public names, stable from version 1.0 ([stability](stability.md)); other names may change at
any time. The page is made from the code
(`python docs/api.py`); `make docs` writes all docstrings as HTML to `build/site/python`.

Lengths are metres, angles radians, entropies nats, AP and recall percent. `DataFrame` is pandas',
`NDArray` numpy's. [Method](method.md) defines the surrogates, [data](data.md) the columns of a box
log, [configuration](configuration.md) the keys of a model such as `SumoScene`.

`evaluate` takes `method="cone"` (exact, the default), `"dda"` or `"bresenham"`. A sensor's
`azimuth=(min, max)` and `range` limit what it covers. `OccupancyGrid.by_class` counts all classes
at once, `evaluate_classes` shares the coverage between them, `sum_over_classes` adds them up as the
paper does, and `evaluate_many` scores a list of placements on all cores. `compare` puts placements
side by side in a table. `Mount.degrees` takes angles in degrees. Placements, grids and results have
`.plot()`, a plotly figure, and are tables in a notebook.
"""

NAMES = {
    "Box logs": {
        "lidarplace.logs.box_log": ("BoxLog", "read_box_log", "write_box_log", "join_logs"),
        "lidarplace.scenes.datasets.tabular": ("read_tabular",),
        "lidarplace.scenes.datasets.nuscenes": ("read_nuscenes",),
        "lidarplace.scenes.datasets.argoverse": ("read_argoverse",),
        "lidarplace.scenes.kitti.read": ("read_kitti",),
        "lidarplace.scenes.sumo.record": ("record",),
        "lidarplace.scenes.sumo.settings": ("SumoScene",),
    },
    "Placements and surrogates": {
        "lidarplace": (
            "PAPER_PLACEMENTS",
            "Mount",
            "Lidar",
            "Placement",
            "Roi",
            "OccupancyGrid",
            "evaluate",
            "evaluate_classes",
            "evaluate_many",
            "compare",
            "expected_ig_of_rays",
            "sum_over_classes",
            "Surrogates",
            "ExpectedRecall",
        ),
        "lidarplace.pog.selection.submodular": ("SubmodularChoice",),
        "lidarplace.recall.choice": ("RecallChoice",),
        "lidarplace.recall.counted_objects": ("CountedObjects",),
        "lidarplace.recall.surface_cells": ("SurfaceCells",),
        "lidarplace.recall.baselines": ("baselines", "per_object"),
        "lidarplace.recall.detection_curve": (
            "DetectionCurve",
            "DetectionCurves",
            "fit",
            "read_curves",
            "write_curves",
            "default_curves",
        ),
        "lidarplace.configuration.placement": ("read_placement",),
        "lidarplace.configuration.correction": (
            "CorrectionFile",
            "read_correction",
            "write_correction",
        ),
        "lidarplace.rigs.correction": ("Correction", "Mask"),
        "lidarplace.rigs.pose": ("rotation", "from_carla"),
    },
    "Point clouds": {
        "lidarplace.clouds.collect": ("collect", "crop_for"),
        "lidarplace.clouds.clouds": ("PointClouds", "read_clouds", "write_clouds"),
        "lidarplace.clouds.visibility": ("ground_truth", "visibility"),
        "lidarplace.scenes.kitti.velodyne": ("read_kitti_clouds",),
    },
    "Detectors and their evaluation": {
        "training": ("NETWORKS", "PRESETS", "DETECTORS", "build_detector"),
        "training.detectors.detector": ("Detector",),
        "training.checkpoints": ("load_checkpoint",),
        "training.kitti_ap": ("evaluate_detections", "evaluate_boxes"),
    },
    "Results": {
        "tracking.run_folders.sweep": ("RunFolder",),
        "tracking.findings.summary": ("summary_table", "seed_means"),
        "tracking.findings.correlation": ("correlate",),
        "tracking.findings.best_placement": ("best_placement", "BestPlacement"),
        "tracking.findings.best_surrogate": ("best_surrogates",),
        "tracking.statistics.power": ("placements_needed", "power_table"),
        "tracking.report.build": ("build_report",),
    },
}
"""Public names by part and module."""


def page() -> str:
    """The page as it should be."""
    parts = [HEAD]
    for title, modules in NAMES.items():
        parts.append(f"## {title}\n")
        for module_name, names in modules.items():
            module = importlib.import_module(module_name)
            parts.append(f"From `{module_name}`:\n")
            parts += [_entry(name, getattr(module, name)) for name in names]
    return "\n".join(parts)


def _entry(name: str, value: Any) -> str:
    if inspect.isclass(value):
        # Keys of a configuration have a page of their own.
        model = issubclass(value, BaseModel)
        lines = [_code(name + ("(**keys)" if model else _signature(value))), _first(value), ""]
        members = [_member(value, *item) for item in _public(value)]
        if value is Surrogates:
            members += [f"- `.{name}`: {SURROGATES[name].meaning}." for name in POG_SURROGATES.own]
        return "\n".join([*lines, *members, ""] if members else lines)
    if inspect.isfunction(value):
        return "\n".join([_code(name + _signature(value)), _first(value), ""])
    known = ", ".join(
        f"`{item}`" for item in (value.names() if isinstance(value, OneOf) else value)
    )
    return f"**`{name}`**: {known}.\n"


def _code(text: str) -> str:
    return f"```text\n{text}\n```\n"


def _member(owner: type, name: str, value: Any) -> str:
    if isinstance(value, (property, functools.cached_property)):
        return f"- `.{name}`: {_first(value)}"
    call = getattr(owner, name)
    return f"- `.{name}{_signature(call, one_line=True)}`: {_first(call)}"


def _public(owner: type) -> Iterator[tuple[str, Any]]:
    """Public methods and properties that the class itself defines, in the order of its file."""
    for name, value in vars(owner).items():
        documented = isinstance(
            value, (property, functools.cached_property, classmethod, staticmethod)
        )
        if not name.startswith("_") and (documented or inspect.isfunction(value)):
            yield name, value


def _first(value: Any) -> str:
    """The first paragraph of a docstring."""
    return " ".join((inspect.getdoc(value) or "").split("\n\n")[0].split())


def _signature(value: Any, one_line: bool = False) -> str:
    signature = inspect.signature(value)
    parts = []
    for parameter in signature.parameters.values():
        if parameter.kind is parameter.KEYWORD_ONLY and "*" not in parts:
            parts.append("*")
        star = {parameter.VAR_POSITIONAL: "*", parameter.VAR_KEYWORD: "**"}.get(parameter.kind, "")
        text = star + parameter.name + _annotation(parameter.annotation, ": ")
        if parameter.default is not parameter.empty:
            text += f" = {_default(parameter.default)}"
        parts.append(text)
    result = _annotation(signature.return_annotation, " -> ")
    line = f"({', '.join(parts)}){result}"
    if one_line or len(line) < 70:
        return line
    return "(\n" + "".join(f"    {part},\n" for part in parts) + f"){result}"


def _annotation(annotation: Any, before: str) -> str:
    if annotation in (inspect.Parameter.empty, None, "None"):
        return ""
    return before + (annotation if isinstance(annotation, str) else _name(annotation))


def _name(annotation: Any) -> str:
    return inspect.formatannotation(annotation).replace("typing.", "")


def _default(value: Any) -> str:
    # The default of a dataclass's field that is made anew for each instance has no value to show.
    return "…" if "factory" in repr(value) else repr(value)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    print(PAGE)
