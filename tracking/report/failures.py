"""Page of what one rig finds and another one misses, with frames to look at."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from numpy.typing import NDArray

from lidarplace.base.number_text import percent
from lidarplace.clouds.points_in_boxes import box_of_points
from lidarplace.logs.boxes import GEOMETRY
from lidarplace.viewing.axes import equal_axes, xyz
from lidarplace.viewing.page import as_json
from lidarplace.viewing.scene import CAMERAS
from lidarplace.viewing.solids import edges, headings
from lidarplace.viewing.vehicle import vehicle_surface
from tracking.figures.kit.style import OUTLINE, QUIET, TOLD, text
from tracking.figures.kit.vehicle_lines import add_lines, vehicle_in_space
from tracking.findings.failures import Failures
from tracking.labels import digits
from tracking.pages.html_page import write_page
from tracking.pages.section import Section
from tracking.run_folders.arrays import FailureFrames
from tracking.run_folders.sweep import RunFolder

FOUND = {"found": "#0072B2", "found by some seeds": "#CC79A7", "missed": "#D55E00"}
"""Colours of objects, and of the points in them, by how many seeds found the object."""
DETECTION = "#009E73"
NEAR_M = (9.0, 9.0, 2.6)  # half of what is in view around the object, along x, y and z
_CLOSE = {
    "eye": {"x": -1.45, "y": 0.0, "z": 0.85},
    "center": {"x": 0.0, "y": 0.0, "z": -0.15},
    "up": {"x": 0.0, "y": 0.0, "z": 1.0},
}
"""Camera behind an object, as plotly takes it."""


def write_failures(
    target: Path,
    run: RunFolder,
    failures: Failures,
    frames: FailureFrames | None,
    section: Section,
    extent: str,
    links: Mapping[str, str],
) -> Path:
    """Write the page to `target`, with links to other pages, by address.

    `frames` are of the same two rigs, `section` is `counted_failures`, whose tables are written;
    `extent` is how much was compared, in one line."""
    vehicle, corners = run.sweep.body, zip(run.roi.x, run.roi.y, run.roi.z, strict=True)
    seen = np.concatenate([[*corners], vehicle_surface(vehicle)[0]])
    whole = equal_axes(seen, longest=1.9) | {"camera": CAMERAS["from above"]}
    return write_page(
        target,
        Path(__file__).with_name("failures.html"),
        [Section("Counted", section.notes[2:], section.figures, section.tables, columns=2)],
        name=" and ".join(failures.rigs),
        rigs=failures.rigs,
        extent=extent,
        links=links,
        said=section.notes[:2],
        frames=_shown(failures, frames) if frames is not None else [],
        colours={**FOUND, f"detected with seed {failures.seeds[0]}": DETECTION},
        whole=json.dumps(whole),
        vehicle=as_json(go.Figure(vehicle_in_space(vehicle), layout={"template": None})),
    )


def _shown(failures: Failures, frames: FailureFrames) -> list[dict[str, Any]]:
    """Describe the frames to click at.

    Keys: `rig`, the place of the one that found more in it; `what` it is shown for and its `fate`;
    `where` it is; `figures` under each rig and plotly's `view`, as JSON."""
    number = {
        int(object_number): row for row, object_number in enumerate(failures.objects["object"])
    }
    described = []
    for place, object_number in enumerate(frames.objects.tolist()):
        row = number[object_number]
        at = failures.objects.iloc[row]
        in_frame = np.flatnonzero(failures.objects["frame"] == at["frame"])
        figures = [
            frame_in_space(
                failures.objects.iloc[in_frame].assign(points=failures.points[rig, in_frame]),
                failures.shares[rig, in_frame],
                frames.points[f"{place}/{rig}"],
                frames.detections[f"{place}/{rig}"],
            )
            for rig in range(2)
        ]
        each = zip(failures.rigs, failures.shares[:, row], failures.points[:, row], strict=True)
        seeds = len(failures.seeds)
        fates = [f"{rig}: {round(of * seeds)} of {seeds}{_points(n)}" for rig, of, n in each]
        centre = at[["x", "y", "z"]].to_numpy(np.float64)
        around = equal_axes(np.stack([centre - NEAR_M, centre + NEAR_M]), longest=1.9)
        described.append(
            {
                "rig": int(failures.shares[1, row] > failures.shares[0, row]),
                "what": f"{at['class']}, {np.hypot(at['x'], at['y']):.0f} m",
                "fate": "; ".join(fates),
                "where": f"{at['scene']}, route {at['route']}, frame {at['frame']}",
                "figures": [as_json(figure) for figure in figures],
                "view": json.dumps(around | {"camera": _CLOSE}),
            }
        )
    return described


def _points(count: float) -> str:
    """Format how many points are on an object; "" where that is unknown."""
    return f", {digits(count, ',.0f')} points" if np.isfinite(count) else ""


def frame_in_space(
    objects: pd.DataFrame,
    shares: NDArray[np.float64],
    points: NDArray[np.float32],
    detections: NDArray[np.float64],
) -> go.Figure:
    """Draw a frame: points in the boxes of objects have the colour of the result, others are grey.

    `objects` have class, points and `GEOMETRY`; `shares` of the seeds found each, shape (objects,);
    `points` have shape (n, 3), `detections` are boxes and scores, shape (d, 8)."""
    plot = go.Figure(layout={"template": None, "margin": dict.fromkeys("lrtb", 0)})
    boxes = objects[list(GEOMETRY)].to_numpy(np.float64)
    fate = np.select([shares == 1, shares > 0], [0, 1], 2)
    owner = box_of_points(points, boxes)
    of_point = np.where(owner >= 0, fate[owner], -1) if len(boxes) else owner
    _add_points(plot, points[of_point < 0], OUTLINE, 1.2)
    for number, shade in enumerate(FOUND.values()):
        _add_points(plot, points[of_point == number], shade, 2.2)
        row = fate == number
        lines = np.concatenate([edges(boxes[row]), headings(boxes[row]).reshape(-1, 3)])
        add_lines(plot, lines, shade, 4, showlegend=False)
    add_lines(plot, edges(detections[:, :7]), DETECTION, 2, showlegend=False)
    roof = boxes[:, :3] + boxes[:, 5:6] * [0, 0, 0.5]
    return plot.add_scatter3d(
        **xyz(roof),
        mode="markers",
        marker={"size": 4, "color": [[*FOUND.values()][i] for i in fate]},
        hovertext=[
            f"{text(row['class'])}<br>found by {percent(share)} of the seeds"
            + _points(row["points"])
            for row, share in zip(objects.to_dict("records"), shares, strict=True)
        ],
        **TOLD,
    )


def _add_points(plot: go.Figure, points: NDArray[np.float32], shade: str, size: float) -> None:
    plot.add_scatter3d(
        **xyz(points),
        mode="markers",
        marker={"size": size, "color": shade, "line": {"width": 0}},
        **QUIET,
    )
